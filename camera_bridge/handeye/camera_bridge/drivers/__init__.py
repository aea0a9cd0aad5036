"""Drivers, one module each: `simulated` (rendered pictures of the simulated lab) and `fake` (for tests, no simulation).

A driver that can be named in the settings has a function `connect(bus)`, a context manager that gives its
(`CameraDriver`, `HeadDriver`).
"""
