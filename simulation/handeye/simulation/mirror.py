"""What the cameras look at: a copy of the world that takes no part in its physics.

The mirror builds the scene into PyBullet clients of its own with the same code as the world, and poses it as the world
was at the very time of an exposure, asked over the lab bus. The pictures are those that the world itself would give,
bit for bit.
"""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Protocol, Self

import pybullet

from handeye.rpc.errors import Internal
from handeye.simulation import rig, scene
from handeye.simulation.camera import Camera, Drawing, Image
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.profile import Profile
from handeye.simulation.scene import WorldState
from handeye.simulation.world import Scene


class Source(Protocol):
    """Where the mirror learns of the world: `handeye.simulation.lab.LabClient`."""

    def scene(self) -> Scene:
        """What stands in the world."""
        ...

    def world(self, world_time: float | None = None) -> WorldState:
        """The truth at a past world time in s; None: now."""
        ...


class Mirror:
    """Takes pictures of the world at given times. Any thread may ask; one is served at a time.

    Two PyBullet clients hold what moves (robot and objects) and what stands still (table and floor), because the latter
    is drawn but once for each pose of a camera (see `handeye.simulation.camera`).
    """

    def __init__(self, lab: Source) -> None:
        self._lab = lab
        self._lock = threading.Lock()
        self._profile = Profile.named(lab.scene().profile)
        self._cameras = {name: Camera(name, self._profile) for name in rig.CAMERAS}
        self._moving = scene.build(pybullet.connect(pybullet.DIRECT))
        self._still = scene.build(pybullet.connect(pybullet.DIRECT))
        _keep(self._moving, robot=True)
        _keep(self._still, robot=False)
        self._still.draw_floor_last()
        self._specs: dict[str, ObjectSpec] = {}
        self._backdrops: dict[rig.CameraName, tuple[bytes, Drawing]] = {}
        self._pictures: dict[rig.CameraName, tuple[tuple[object, ...], Image]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Lets go of the PyBullet clients."""
        with self._lock:
            for stage in (self._moving, self._still):
                if pybullet.isConnected(stage.client):
                    pybullet.disconnect(stage.client)

    def prepare(self, pan: float, tilt: float) -> None:
        """Draws what stands still for the head at (pan, tilt) in rad: then the first pictures are as fast as others."""
        with self._lock:
            for name, camera in self._cameras.items():
                self._backdrop(camera, rig.camera_from_world(name, pan, tilt))

    def picture(self, camera: rig.CameraName, world_time: float, pan: float, tilt: float) -> tuple[Image, float]:
        """What a camera sees at a world time in s with the head at (pan, tilt) in rad, and the exact time of that.

        The same array again while nothing of it has changed since the camera's last picture.
        """
        with self._lock:
            there = self._lab.scene()
            if there.profile != self._profile.name:
                raise Internal(f"the world is {there.profile} now, no longer {self._profile.name}: restart the cameras")
            state = self._lab.world(world_time)
            bump = there.conditions.head_bump
            camera_from_world = rig.camera_from_world(camera, pan + bump[0], tilt + bump[1])
            step = round(state.world_time / scene.STEP)
            shown = (there.seed, there.objects, step, camera_from_world.tobytes(), _poses(state))
            last = self._pictures.get(camera)
            if last is None or last[0] != shown:
                self._set_up(there.objects)
                self._moving.apply(state)
                last = (shown, self._take(camera, camera_from_world, there.seed, step))
                self._pictures[camera] = last
            return last[1], state.world_time

    def _take(self, name: rig.CameraName, camera_from_world: rig.Matrix, seed: int, step: int) -> Image:
        camera = self._cameras[name]
        drawing = camera.draw(self._moving.client, camera_from_world).over(self._backdrop(camera, camera_from_world))
        image = camera.develop(drawing, seed, step)
        image.setflags(write=False)
        return image

    def _set_up(self, specs: tuple[ObjectSpec, ...]) -> None:
        """Adds and removes objects until they are those of the world."""
        wanted = {spec.name: spec for spec in specs}
        for name in [name for name, spec in self._specs.items() if wanted.get(name) != spec]:
            self._moving.remove(name)
            del self._specs[name]
        for spec in specs:
            if spec.name not in self._specs:
                self._moving.add(spec)
                self._specs[spec.name] = spec

    def _backdrop(self, camera: Camera, camera_from_world: rig.Matrix) -> Drawing:
        """What stands still, drawn anew only when the camera has another pose than last time."""
        pose = camera_from_world.tobytes()
        last = self._backdrops.get(camera.name)
        if last is None or last[0] != pose:
            last = (pose, camera.draw(self._still.client, camera_from_world))
            self._backdrops[camera.name] = last
        return last[1]


def _poses(state: WorldState) -> tuple[object, ...]:
    """All of a state that shows in a picture, to compare."""
    poses = ((item.name, item.pose.position.tobytes(), item.pose.orientation.tobytes()) for item in state.objects)
    return state.joints.tobytes(), state.fingers.tobytes(), state.liquid.tobytes(), *poses


def _keep(stage: scene.Stage, *, robot: bool) -> None:
    """Removes everything but the robot, or only the robot."""
    bodies = [
        pybullet.getBodyUniqueId(index, physicsClientId=stage.client)
        for index in range(pybullet.getNumBodies(physicsClientId=stage.client))
    ]
    for body in bodies:
        if (body == stage.robot) != robot:
            pybullet.removeBody(body, physicsClientId=stage.client)
