"""Drivers, one module each: `simulated` renders pictures of the simulated lab.

A driver that can be named in the settings has a function `connect(bus)`, a context manager that gives its
(`CameraDriver`, `HeadDriver`).
"""
