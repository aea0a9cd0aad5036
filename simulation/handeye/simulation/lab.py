"""The lab bus: truth and object placement of a simulated world, for simulated cameras, teacher and scoring."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self, cast

import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray

from handeye.proto import methods
from handeye.proto.v1 import lab_pb2
from handeye.rpc import Bus, Call, Method
from handeye.rpc.errors import InvalidArgument
from handeye.simulation.conditions import ORDINARY, Conditions
from handeye.simulation.objects import ObjectSpec, Shape
from handeye.simulation.pose import Pose
from handeye.simulation.scene import ObjectState, WorldState
from handeye.simulation.world import Clock, Scene, World

Array = NDArray[np.float64]

_TIMEOUT = 5.0
_FILLING_TIMEOUT = 30.0  # s: liquid settles for 1 s of world time, which a busy machine takes long for


class LabService:
    """Answers the `Lab` service for a world, while its context is open."""

    def __init__(self, world: World, bus: Bus) -> None:
        self._world = world
        handlers: dict[Method[Any, Any], Callable[[Any, Call], Message]] = {
            methods.LAB_DESCRIBE_SCENE: self._describe,
            methods.LAB_GET_WORLD: self._get_world,
            methods.LAB_GET_HISTORY: self._get_history,
            methods.LAB_RESET_WORLD: self._reset,
            methods.LAB_PLACE_OBJECT: self._place,
            methods.LAB_HOLD_OBJECT: self._hold,
            methods.LAB_FILL_OBJECT: self._fill,
            methods.LAB_PUSH_OBJECT: self._push,
            methods.LAB_REMOVE_OBJECT: self._remove,
        }
        self._serving = bus.serve(handlers)

    def __enter__(self) -> Self:
        self._serving.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._serving.__exit__(kind, error, trace)

    def _describe(self, _request: lab_pb2.DescribeSceneRequest, _call: Call) -> lab_pb2.Scene:
        return scene_to_proto(self._world.scene())

    def _get_world(self, request: lab_pb2.GetWorldRequest, _call: Call) -> lab_pb2.WorldState:
        return state_to_proto(self._world.state(_time(request.world_time)))

    def _get_history(self, request: lab_pb2.GetHistoryRequest, _call: Call) -> lab_pb2.WorldHistory:
        states = self._world.history(request.start, _time(request.end), request.every)
        return lab_pb2.WorldHistory(states=[state_to_proto(state) for state in states])

    def _reset(self, request: lab_pb2.ResetWorldRequest, _call: Call) -> lab_pb2.Scene:
        conditions = conditions_from_proto(request.conditions) if request.HasField("conditions") else ORDINARY
        return scene_to_proto(self._world.reset(request.seed, conditions))

    def _place(self, request: lab_pb2.PlaceObjectRequest, _call: Call) -> lab_pb2.Scene:
        if len(request.position) != 2:
            raise InvalidArgument(f"position must be (x, y), got {list(request.position)}", detail="position")
        spec = spec_from_proto(request.object)
        return scene_to_proto(self._world.place(spec, list(request.position), request.yaw))

    def _hold(self, request: lab_pb2.HoldObjectRequest, _call: Call) -> lab_pb2.Scene:
        return scene_to_proto(self._world.hold(spec_from_proto(request.object), _pose_from_proto(request.pose)))

    def _fill(self, request: lab_pb2.FillObjectRequest, _call: Call) -> lab_pb2.Scene:
        return scene_to_proto(self._world.fill(request.name, request.particles))

    def _push(self, request: lab_pb2.PushObjectRequest, _call: Call) -> lab_pb2.Push:
        path = [list(place.position) for place in request.path]
        if any(len(position) != 2 for position in path):
            raise InvalidArgument(f"each place of path must be (x, y), got {path}", detail="path")
        return lab_pb2.Push(ends=self._world.push(request.name, path, request.speed))

    def _remove(self, request: lab_pb2.RemoveObjectRequest, _call: Call) -> lab_pb2.Scene:
        return scene_to_proto(self._world.remove(request.name))


class LabClient:
    """The lab seen from another process: the same calls as `World`, and the same errors."""

    def __init__(self, bus: Bus, timeout: float = _TIMEOUT) -> None:
        self._bus = bus
        self._timeout = timeout

    def scene(self) -> Scene:
        """What stands in the world."""
        request = lab_pb2.DescribeSceneRequest()
        return scene_from_proto(self._bus.call(methods.LAB_DESCRIBE_SCENE, request, timeout=self._timeout))

    def world(self, world_time: float | None = None) -> WorldState:
        """The truth now (None) or at a past world time, to the nearest physics step."""
        request = lab_pb2.GetWorldRequest(world_time=-1.0 if world_time is None else world_time)
        return state_from_proto(self._bus.call(methods.LAB_GET_WORLD, request, timeout=self._timeout))

    def history(self, start: float, end: float | None = None, every: float = 0.0) -> list[WorldState]:
        """The truth from `start` to `end` (None: now), one state every `every` s (0: every step), oldest first."""
        request = lab_pb2.GetHistoryRequest(start=start, end=-1.0 if end is None else end, every=every)
        answer = self._bus.call(methods.LAB_GET_HISTORY, request, timeout=self._timeout)
        return [state_from_proto(state) for state in answer.states]

    def reset(self, seed: int = 0, conditions: Conditions = ORDINARY) -> Scene:
        """Rebuilds the world; `Busy` during a motion."""
        request = lab_pb2.ResetWorldRequest(seed=seed, conditions=conditions_to_proto(conditions))
        return scene_from_proto(self._bus.call(methods.LAB_RESET_WORLD, request, timeout=self._timeout))

    def place(self, spec: ObjectSpec, xy: Sequence[float] | Array, yaw: float = 0.0) -> Scene:
        """Puts an object on the table, its axis at `xy` (m); it has settled when the call returns."""
        request = lab_pb2.PlaceObjectRequest(object=spec_to_proto(spec), position=[float(xy[0]), float(xy[1])], yaw=yaw)
        return scene_from_proto(self._bus.call(methods.LAB_PLACE_OBJECT, request, timeout=self._timeout))

    def hold(self, spec: ObjectSpec, pose: Pose) -> Scene:
        """Holds an object in the air at `pose`, where nothing moves it."""
        request = lab_pb2.HoldObjectRequest(object=spec_to_proto(spec), pose=_pose_to_proto(pose))
        return scene_from_proto(self._bus.call(methods.LAB_HOLD_OBJECT, request, timeout=self._timeout))

    def fill(self, name: str, particles: int) -> Scene:
        """Fills liquid into a cup that stands upright; it has settled when the call returns."""
        request = lab_pb2.FillObjectRequest(name=name, particles=particles)
        return scene_from_proto(self._bus.call(methods.LAB_FILL_OBJECT, request, timeout=_FILLING_TIMEOUT))

    def push(self, name: str, path: Sequence[Sequence[float]] | Array, speed: float) -> float:
        """Begins to push an object from place (x, y) to place, m, at `speed`, m/s; the world time when it is there."""
        places = [lab_pb2.Place(position=[float(x), float(y)]) for x, y in path]
        request = lab_pb2.PushObjectRequest(name=name, path=places, speed=speed)
        return self._bus.call(methods.LAB_PUSH_OBJECT, request, timeout=self._timeout).ends

    def remove(self, name: str) -> Scene:
        """Takes an object away."""
        request = lab_pb2.RemoveObjectRequest(name=name)
        return scene_from_proto(self._bus.call(methods.LAB_REMOVE_OBJECT, request, timeout=self._timeout))


def spec_to_proto(spec: ObjectSpec) -> lab_pb2.ObjectSpec:
    """An object as a message."""
    return lab_pb2.ObjectSpec(
        name=spec.name,
        shape=spec.shape,
        radius=spec.radius,
        height=spec.height,
        wall=spec.wall,
        mass=spec.mass,
        color=spec.color,
    )


def spec_from_proto(message: lab_pb2.ObjectSpec) -> ObjectSpec:
    """An object from a message; `InvalidArgument` says what is wrong with it."""
    if len(message.color) != 3:
        raise InvalidArgument(f"color must be (red, green, blue), got {list(message.color)}", detail="color")
    red, green, blue = message.color
    try:
        return ObjectSpec(
            name=message.name,
            shape=cast(Shape, message.shape),
            radius=message.radius,
            height=message.height,
            wall=message.wall,
            mass=message.mass,
            color=(red, green, blue),
        )
    except ValueError as error:
        raise InvalidArgument(str(error), detail="object") from error


def scene_to_proto(scene: Scene) -> lab_pb2.Scene:
    """A scene as a message."""
    return lab_pb2.Scene(
        version=scene.version,
        objects=[spec_to_proto(spec) for spec in scene.objects],
        seed=scene.seed,
        profile=scene.profile,
        clock=scene.clock,
        conditions=conditions_to_proto(scene.conditions),
    )


def scene_from_proto(message: lab_pb2.Scene) -> Scene:
    """A scene from a message."""
    return Scene(
        version=message.version,
        objects=tuple(spec_from_proto(spec) for spec in message.objects),
        seed=message.seed,
        profile=message.profile,
        clock=cast(Clock, message.clock),
        conditions=conditions_from_proto(message.conditions),
    )


def conditions_to_proto(conditions: Conditions) -> lab_pb2.Conditions:
    """Conditions as a message."""
    return lab_pb2.Conditions(
        opening=conditions.opening,
        joint_offsets=conditions.joint_offsets,
        head_bump=conditions.head_bump,
        push=conditions.push,
        slip=conditions.slip,
    )


def conditions_from_proto(message: lab_pb2.Conditions) -> Conditions:
    """Conditions from a message; `InvalidArgument` says what is wrong with them."""
    try:
        (pan, tilt), (x, y) = message.head_bump, message.push
        return Conditions(message.opening, tuple(message.joint_offsets), (pan, tilt), (x, y), message.slip)
    except ValueError as error:
        raise InvalidArgument(str(error), detail="conditions") from error


def state_to_proto(state: WorldState) -> lab_pb2.WorldState:
    """The truth at one time as a message."""
    return lab_pb2.WorldState(
        world_time=state.world_time,
        scene_version=state.scene_version,
        joints=state.joints.tolist(),
        fingers=state.fingers.tolist(),
        tool=_pose_to_proto(state.tool),
        objects=[
            lab_pb2.ObjectPose(
                name=item.name,
                pose=_pose_to_proto(item.pose),
                touches_finger_1=item.touches_finger_1,
                touches_finger_2=item.touches_finger_2,
            )
            for item in state.objects
        ],
        liquid=state.liquid.ravel().tolist(),
    )


def state_from_proto(message: lab_pb2.WorldState) -> WorldState:
    """The truth at one time from a message."""
    return WorldState(
        world_time=message.world_time,
        scene_version=message.scene_version,
        joints=np.array(message.joints),
        fingers=np.array(message.fingers),
        tool=_pose_from_proto(message.tool),
        objects=tuple(
            ObjectState(item.name, _pose_from_proto(item.pose), item.touches_finger_1, item.touches_finger_2)
            for item in message.objects
        ),
        liquid=np.array(message.liquid, dtype=np.float64).reshape(-1, 3),
    )


def _pose_to_proto(pose: Pose) -> lab_pb2.Pose:
    return lab_pb2.Pose(position=pose.position.tolist(), orientation=pose.orientation.tolist())


def _pose_from_proto(message: lab_pb2.Pose) -> Pose:
    return Pose(np.array(message.position), np.array(message.orientation))


def _time(world_time: float) -> float | None:
    """Negative means now."""
    return None if world_time < 0 else world_time
