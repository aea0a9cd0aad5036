"""The errors of a call, the same classes on both sides of the bus and in the drivers."""

from typing import ClassVar

from handeye.proto.v1 import rpc_pb2


class RpcError(Exception):
    """A call failed. `str(error)` is a sentence for people; `detail` is for programs."""

    code: ClassVar[rpc_pb2.ErrorCode.ValueType] = rpc_pb2.ERROR_CODE_INTERNAL

    def __init__(self, message: str, detail: str = "") -> None:
        super().__init__(message)
        self.message, self.detail = message, detail


class Unavailable(RpcError):
    """Nobody serves the method, or the server died or was cut off during the call."""

    code = rpc_pb2.ERROR_CODE_UNAVAILABLE


class DeadlineExceeded(RpcError):
    """The caller's time ran out."""

    code = rpc_pb2.ERROR_CODE_DEADLINE_EXCEEDED


class InvalidArgument(RpcError):
    """The request itself is wrong: a shape, a range, an unknown name."""

    code = rpc_pb2.ERROR_CODE_INVALID_ARGUMENT


class OutOfLimits(RpcError):
    """A joint, speed or workspace limit forbids the motion."""

    code = rpc_pb2.ERROR_CODE_OUT_OF_LIMITS


class Unreachable(RpcError):
    """No joint position reaches the point."""

    code = rpc_pb2.ERROR_CODE_UNREACHABLE


class Busy(RpcError):
    """Somebody else holds the control lease, or a motion is under way."""

    code = rpc_pb2.ERROR_CODE_BUSY


class Stopped(RpcError):
    """The robot is stopped (software stop, silent lease holder); reset it first."""

    code = rpc_pb2.ERROR_CODE_STOPPED


class Unauthorised(RpcError):
    """The caller lacks the lease or the credential that the method needs."""

    code = rpc_pb2.ERROR_CODE_UNAUTHORISED


class Cancelled(RpcError):
    """The caller cancelled the call."""

    code = rpc_pb2.ERROR_CODE_CANCELLED


class Slipping(RpcError):
    """The gripper closed further than it should: what it held slips. The arm has braked, and the gripper has opened."""

    code = rpc_pb2.ERROR_CODE_SLIPPING


class Internal(RpcError):
    """The handler raised something unforeseen: a bug on the server's side."""


_BY_CODE: dict[int, type[RpcError]] = {cls.code: cls for cls in RpcError.__subclasses__()}


def from_status(status: rpc_pb2.Status) -> RpcError:
    """The exception that a `Status` stands for; an unknown code becomes `Internal`."""
    return _BY_CODE.get(status.code, Internal)(status.message, status.detail)


def to_status(error: BaseException) -> rpc_pb2.Status:
    """The `Status` that carries `error`; what is no `RpcError` is `INTERNAL` with its class name."""
    if isinstance(error, RpcError):
        return rpc_pb2.Status(code=error.code, message=error.message, detail=error.detail)
    return rpc_pb2.Status(code=rpc_pb2.ERROR_CODE_INTERNAL, message=f"{type(error).__name__}: {error}")
