"""Collecting samples without a teacher (the thesis's first wish, 4.3): the system moves, looks, and writes down.

`babbling` moves the arm for AJS, CAS and IJS; `fixating` turns the head for SCS; `viewing` looks at a grid that
somebody holds at a known place, for CSS.
"""
