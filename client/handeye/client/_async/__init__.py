"""The client in tasks (asyncio); what it does in threads is made from it by `tools/make_sync.py`."""
