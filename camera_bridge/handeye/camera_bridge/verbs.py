"""The verb `handeye camera-bridge`."""

from __future__ import annotations

from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Adds the verb `camera-bridge` to the `handeye` command."""

    @app.command("camera-bridge")
    def camera_bridge(
        watch_parent: Annotated[bool, typer.Option("--watch-parent", help="End when stdin ends.")] = False,
    ) -> None:
        """Own cameras and head and serve them until TERM or Ctrl-C (settings: HANDEYE_CAMERA_*, _BUS_*, _LAB_BUS_*)."""
        # Here, because every `handeye` command imports this module, and most need no bus.
        from handeye.camera_bridge.bridge import run
        from handeye.camera_bridge.settings import CameraBridgeSettings
        from handeye.rpc.process import configure_logging, until_stopped

        configure_logging()
        with until_stopped(watch_parent) as stop:
            run(CameraBridgeSettings(), stop)
