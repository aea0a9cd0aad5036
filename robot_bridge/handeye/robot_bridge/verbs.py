"""The verb `handeye robot-bridge`."""

from __future__ import annotations

from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Adds the verb `robot-bridge` to the `handeye` command."""

    @app.command("robot-bridge")
    def robot_bridge(
        watch_parent: Annotated[bool, typer.Option("--watch-parent", help="End when stdin ends.")] = False,
    ) -> None:
        """Own a robot and serve it until TERM or Ctrl-C (settings: HANDEYE_ROBOT_*, _BUS_*, _LAB_BUS_*)."""
        # Here, because every `handeye` command imports this module, and most need no bus.
        from handeye.robot_bridge.bridge import run
        from handeye.robot_bridge.settings import RobotBridgeSettings
        from handeye.rpc.process import configure_logging, until_stopped

        configure_logging()
        with until_stopped(watch_parent) as stop:
            run(RobotBridgeSettings(), stop)
