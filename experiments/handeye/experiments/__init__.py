"""Every table and figure: what handeye's learner is compared with, and on what."""
