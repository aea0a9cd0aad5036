"""The coordinator: a REST service that watches demonstrations, trains modules from them and runs tasks.

`coordinator` wires everything together; `routes` are what callers see; `executor` is the acting loop; `training` makes
pairs of demonstrations. It talks to the bridges over the bus only. All is kept in memory for now: objects,
demonstrations, trained tasks and jobs do not survive a restart.

The package itself imports nothing: every `handeye` command loads it to find the verb `server`.
"""
