"""One typed constant for each rpc of the four services, and for each stream (the `.proto` files are the contract)."""

from __future__ import annotations

from handeye.proto.v1 import camera_pb2, lab_pb2, robot_pb2
from handeye.rpc.method import Method, Stream

ROBOT_DESCRIBE = Method("Robot", "Describe", robot_pb2.DescribeRobotRequest, robot_pb2.RobotDescription)
ROBOT_GET_STATE = Method("Robot", "GetState", robot_pb2.GetStateRequest, robot_pb2.RobotState)
ROBOT_ACQUIRE_LEASE = Method("Robot", "AcquireLease", robot_pb2.AcquireLeaseRequest, robot_pb2.Lease)
ROBOT_RELEASE_LEASE = Method("Robot", "ReleaseLease", robot_pb2.ReleaseLeaseRequest, robot_pb2.RobotState)
ROBOT_PARK = Method("Robot", "Park", robot_pb2.ParkRequest, robot_pb2.RobotState, robot_pb2.MotionProgress)
ROBOT_OPEN_GRIPPER = Method(
    "Robot", "OpenGripper", robot_pb2.GripperRequest, robot_pb2.RobotState, robot_pb2.MotionProgress
)
ROBOT_CLOSE_GRIPPER = Method(
    "Robot", "CloseGripper", robot_pb2.GripperRequest, robot_pb2.RobotState, robot_pb2.MotionProgress
)
ROBOT_MOVE_TO_POINT = Method(
    "Robot", "MoveToPoint", robot_pb2.MoveToPointRequest, robot_pb2.RobotState, robot_pb2.MotionProgress
)
ROBOT_MOVE_TO_JOINTS = Method(
    "Robot", "MoveToJoints", robot_pb2.MoveToJointsRequest, robot_pb2.RobotState, robot_pb2.MotionProgress
)
ROBOT_ADJUST_JOINTS = Method(
    "Robot", "AdjustJoints", robot_pb2.AdjustJointsRequest, robot_pb2.RobotState, robot_pb2.MotionProgress
)
ROBOT_ADVANCE = Method("Robot", "Advance", robot_pb2.AdvanceRequest, robot_pb2.RobotState, robot_pb2.MotionProgress)
ROBOT_STOP = Method("Robot", "Stop", robot_pb2.StopRequest, robot_pb2.RobotState)
ROBOT_RESET = Method("Robot", "Reset", robot_pb2.ResetRequest, robot_pb2.RobotState)

CAMERA_DESCRIBE = Method("Camera", "Describe", camera_pb2.DescribeCameraRequest, camera_pb2.CameraDescription)
CAMERA_GRAB_STEREO = Method("Camera", "GrabStereo", camera_pb2.GrabStereoRequest, camera_pb2.StereoPair)
CAMERA_GRAB_OBSERVER = Method("Camera", "GrabObserver", camera_pb2.GrabObserverRequest, camera_pb2.Frame)
CAMERA_GET_HEAD = Method("Camera", "GetHead", camera_pb2.GetHeadRequest, camera_pb2.HeadState)
CAMERA_MOVE_HEAD = Method("Camera", "MoveHead", camera_pb2.MoveHeadRequest, camera_pb2.HeadState)
CAMERA_FOLLOW_HEAD = Method("Camera", "FollowHead", camera_pb2.FollowHeadRequest, camera_pb2.HeadState)

LAB_DESCRIBE_SCENE = Method("Lab", "DescribeScene", lab_pb2.DescribeSceneRequest, lab_pb2.Scene)
LAB_GET_WORLD = Method("Lab", "GetWorld", lab_pb2.GetWorldRequest, lab_pb2.WorldState)
LAB_GET_HISTORY = Method("Lab", "GetHistory", lab_pb2.GetHistoryRequest, lab_pb2.WorldHistory)
LAB_RESET_WORLD = Method("Lab", "ResetWorld", lab_pb2.ResetWorldRequest, lab_pb2.Scene)
LAB_PLACE_OBJECT = Method("Lab", "PlaceObject", lab_pb2.PlaceObjectRequest, lab_pb2.Scene)
LAB_HOLD_OBJECT = Method("Lab", "HoldObject", lab_pb2.HoldObjectRequest, lab_pb2.Scene)
LAB_FILL_OBJECT = Method("Lab", "FillObject", lab_pb2.FillObjectRequest, lab_pb2.Scene)
LAB_PUSH_OBJECT = Method("Lab", "PushObject", lab_pb2.PushObjectRequest, lab_pb2.Push)
LAB_REMOVE_OBJECT = Method("Lab", "RemoveObject", lab_pb2.RemoveObjectRequest, lab_pb2.Scene)

ROBOT_HEARTBEAT = Stream("Robot", "Heartbeat", robot_pb2.Heartbeat, urgent=True)
"""Published by the lease holder's control loop every 20 ms of a motion."""
ROBOT_STATE = Stream("Robot", "State", robot_pb2.RobotState)
"""Published by the robot bridge at 50 Hz or more."""
CAMERA_STEREO = Stream("Camera", "Stereo", camera_pb2.StereoPair)
"""Published by the camera bridge, as often as it grabs or renders."""
