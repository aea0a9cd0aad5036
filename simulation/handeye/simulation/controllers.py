"""The controllers of arm and gripper: what drives the joints of the simulated robot at every physics step."""

from __future__ import annotations

from collections import deque

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.simulation import gripper, puma
from handeye.simulation.motion import JointMotion
from handeye.simulation.profile import Profile
from handeye.simulation.scene import ARM_JOINTS, FINGER_1, FINGER_2, STEP, Stage

Array = NDArray[np.float64]

_POSITION_GAIN = 0.2
_GEAR_FORCE = 500.0
_STALLED_STEPS = 12
_STALLED_WAY = 1e-4  # m in so many steps


class ArmController:
    """Drives the six joints along motions and holds them, through gears with play.

    A joint's motor follows the motion exactly; its link hangs behind by the play operator: it stands still while the
    motor turns inside the play, and is dragged at the play's edge. The encoder sits on the motor.
    """

    def __init__(self, stage: Stage, profile: Profile, motor: Array, offsets: Array, rng: np.random.Generator) -> None:
        """It begins where encoders read `motor` (6,), rad; they read `offsets` (6,), rad, too much."""
        self._stage = stage
        self._half_play = profile.backlash / 2
        self._encoder_step = puma.ENCODER_STEP if profile.encoder else None
        self._motor = motor.copy()
        self._offsets = offsets
        self._motor_speed = np.zeros(6)
        # Where in the play a link rests is chance.
        self._link = motor - offsets + rng.uniform(-1.0, 1.0, 6) * self._half_play
        self._motion: JointMotion | None = None

    @property
    def link(self) -> Array:
        """Where the links are led to (6,), rad."""
        return self._link.copy()

    @property
    def motor(self) -> Array:
        """Where the motors are led to, counted at the joints (6,), rad: what `move to joints` commands."""
        return self._motor.copy()

    @property
    def motion(self) -> JointMotion | None:
        """The motion under way."""
        return self._motion

    def follow(self, motion: JointMotion) -> None:
        """Starts a motion that begins where the motors are."""
        self._motion = motion

    def brake(self) -> None:
        """Brings the motion to a standstill."""
        if self._motion is not None:
            self._motion.brake()

    def drive(self) -> None:
        """Commands the joints for the coming physics step."""
        motor = self._motor
        if self._motion is not None:
            motor = self._motion.advance()
            if self._motion.finished:
                self._motion = None
        driven = motor - self._offsets
        link = np.clip(self._link, driven - self._half_play, driven + self._half_play)
        # Position where the link should be now and the speed that brings it to where it should be next: the motor
        # constraint then has no lag to make up for.
        pybullet.setJointMotorControlArray(
            self._stage.robot,
            ARM_JOINTS,
            pybullet.POSITION_CONTROL,
            targetPositions=self._link.tolist(),
            targetVelocities=((link - self._link) / STEP).tolist(),
            forces=puma.TORQUE.tolist(),
            positionGains=[_POSITION_GAIN] * 6,
            velocityGains=[1.0] * 6,
            physicsClientId=self._stage.client,
        )
        self._motor_speed = (motor - self._motor) / STEP
        self._motor, self._link = motor, link

    def encoders(self, joints: Array) -> Array:
        """What the encoders read while the links are at `joints` (6,), rad."""
        # The offsets are in it: motors are counted as the encoders read them.
        reading = joints + (self._motor - self._link)
        if self._encoder_step is None:
            return reading
        return np.round(reading / self._encoder_step) * self._encoder_step

    @property
    def motor_speed(self) -> Array:
        """How fast the motors are led, counted at the joints (6,), rad/s."""
        return self._motor_speed.copy()


class GripperController:
    """Drives the two fingers, coupled by a gear: opens by position, closes until a force is reached."""

    def __init__(self, stage: Stage, force: float, travel: float) -> None:
        """The fingers press with `force`, in N, and each travels `travel` m from the middle."""
        self._stage = stage
        self._force = force
        self._travel = travel
        self._reference = self._goal = travel
        self._seen = deque([np.full(2, travel)] * (_STALLED_STEPS + 1), _STALLED_STEPS + 1)
        # The one constraint of the robot: finger to finger, never to an object. The master's force is shared by both.
        gear = pybullet.createConstraint(
            stage.robot,
            FINGER_1,
            stage.robot,
            FINGER_2,
            pybullet.JOINT_GEAR,
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0],
            physicsClientId=stage.client,
        )
        pybullet.changeConstraint(gear, gearRatio=-1, maxForce=_GEAR_FORCE, physicsClientId=stage.client)
        pybullet.setJointMotorControl2(
            stage.robot, FINGER_2, pybullet.VELOCITY_CONTROL, force=0.0, physicsClientId=stage.client
        )

    @property
    def settled(self) -> bool:
        """The fingers are where they were sent, or something between them holds them up.

        On average over some steps: between them it may twitch.
        """
        if self._reference != self._goal or len(self._seen) <= _STALLED_STEPS:
            return False
        return bool(np.abs(self._seen[-1] - self._seen[0]).max() < _STALLED_WAY)

    @property
    def fraction(self) -> float:
        """Share of the way to the goal that the fingers have been led, 0..1."""
        return 1.0 - abs(self._goal - self._reference) / self._travel

    def open(self, fingers: Array) -> None:
        """Sends the fingers (2,), m, apart, from where they are: a grip is let go at once."""
        self._reference = float(fingers[0])
        self._send(self._travel)

    def close(self) -> None:
        """Sends the fingers together."""
        self._send(0.0)

    def hold(self, fingers: Array) -> None:
        """Stops the fingers where they are (2,), m; a grip that is closing keeps its force."""
        if self._reference != self._goal:
            self._reference = self._goal = float(fingers[0])

    def drive(self) -> None:
        """Commands the fingers for the coming physics step."""
        limit = gripper.SPEED * STEP
        self._reference += min(limit, max(-limit, self._goal - self._reference))
        pybullet.setJointMotorControl2(
            self._stage.robot,
            FINGER_1,
            pybullet.POSITION_CONTROL,
            targetPosition=self._reference,
            force=2 * self._force,
            positionGain=_POSITION_GAIN,
            velocityGain=1.0,
            physicsClientId=self._stage.client,
        )

    def observe(self, fingers: Array) -> None:
        """Takes note of where the fingers (2,) are after a physics step, in m."""
        self._seen.append(fingers)

    def _send(self, goal: float) -> None:
        self._goal = goal
        self._seen.clear()
