"""The store: what the coordinator knows, in SQLite or PostgreSQL. It is the truth; trees in memory are rebuilt from it.

`engine` opens it and gives transactions, `tables` says what is in it, `rows` seals every row with a checksum,
`migrations` brings older stores up to date. The other modules read and write one kind of thing each: functions that
take a connection, so that what belongs together is written in one transaction.
"""

from handeye.server.store.engine import Store, StoreBusy, StoreError

__all__ = ["Store", "StoreBusy", "StoreError"]
