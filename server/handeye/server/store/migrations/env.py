"""Runs migrations on the connection that `handeye.server.store.upgrade` hands over."""

from alembic import context

from handeye.server.store.tables import metadata

context.configure(connection=context.config.attributes["connection"], target_metadata=metadata)
context.run_migrations()
