# Made by tools/make_sync.py from client/handeye/client/_async/__init__.py: change that, then `make sync`.
"""The client in threads; made by `tools/make_sync.py`."""
