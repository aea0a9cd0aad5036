"""The simulated laboratory: PUMA 560, gripper, cups and table in PyBullet, its cameras, its teacher and its truth.

Nothing is re-exported here: reports and scoring are used where PyBullet is not. `world.World` is the lab itself,
`lab.LabClient` the same from another process, `objects.CUPS` what can be put on the table.
"""
