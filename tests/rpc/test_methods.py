"""The `.proto` files are the contract: commented throughout, and spelled in Python completely."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from google.protobuf.message import Message

import handeye.proto.v1
from handeye.proto import methods
from handeye.proto.v1 import camera_pb2, lab_pb2, robot_pb2, rpc_pb2
from handeye.rpc import Method, Stream, errors
from handeye.rpc.method import key

PROTO = sorted(Path(handeye.proto.v1.__path__[0]).glob("*.proto"))
SERVICES = [
    service
    for module in (camera_pb2, lab_pb2, robot_pb2, rpc_pb2)
    for service in module.DESCRIPTOR.services_by_name.values()
]


def constant(service: str, name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", f"{service}_{name}").upper()


@pytest.mark.parametrize(
    ("service", "name"), [(service.name, name) for service in SERVICES for name in service.methods_by_name]
)
def test_every_rpc_has_a_method(service: str, name: str) -> None:
    method = getattr(methods, constant(service, name))
    assert (method.service, method.name) == (service, name)


def test_every_method_is_named_after_its_rpc_and_no_two_share_a_key() -> None:
    declared = {name: value for name, value in vars(methods).items() if isinstance(value, Method | Stream)}
    assert declared
    for name, value in declared.items():
        assert name == constant(value.service, value.name)
    assert len({key("cell", value.service, value.name) for value in declared.values()}) == len(declared)


def test_keys() -> None:
    assert key("lab7", "Robot", "MoveToJoints") == "handeye/lab7/robot/move_to_joints"


@pytest.mark.parametrize(
    ("service", "name", "request_type", "response_type"),
    [
        ("Robot", "Dance", robot_pb2.ParkRequest, robot_pb2.RobotState),
        ("Toaster", "Park", robot_pb2.ParkRequest, robot_pb2.RobotState),
        ("Robot", "Park", robot_pb2.StopRequest, robot_pb2.RobotState),
        ("Robot", "Park", robot_pb2.ParkRequest, robot_pb2.Lease),
    ],
)
def test_a_method_that_the_contract_does_not_know_is_refused(
    service: str, name: str, request_type: type[Message], response_type: type[Message]
) -> None:
    with pytest.raises(TypeError, match=f"{service}.{name}"):
        Method(service, name, request_type, response_type)


def test_every_error_code_is_one_class() -> None:
    codes = set(rpc_pb2.ErrorCode.values()) - {rpc_pb2.ERROR_CODE_UNSPECIFIED}
    for code in codes:
        error = errors.from_status(rpc_pb2.Status(code=code, message="m", detail="d"))
        assert errors.to_status(error) == rpc_pb2.Status(code=code, message="m", detail="d")
    assert type(errors.from_status(rpc_pb2.Status())) is errors.Internal


def declarations(text: str) -> Iterator[tuple[str, str]]:
    """Each line that declares something, with the line above it."""
    above = ""
    for line in text.splitlines():
        declaration = re.match(
            r"\s*(message|service|enum|rpc|(repeated |optional )?[\w.]+ \w+ = \d+|\w+ = \d+)\b", line
        )
        if declaration and not line.rstrip().endswith("{}"):
            yield line.strip(), above.strip()
        above = line


@pytest.mark.parametrize("path", PROTO, ids=lambda path: path.name)
def test_everything_in_the_proto_files_is_commented(path: Path) -> None:
    text = path.read_text()
    found = list(declarations(text))
    assert found
    bare = [line for line, above in found if not above.startswith("//")]
    assert not bare, f"{path.name} does not say what these are: {bare}"


def test_joints_are_repeated_fields() -> None:
    for module in (camera_pb2, lab_pb2, robot_pb2):
        for message in module.DESCRIPTOR.message_types_by_name.values():
            for field in message.fields:
                assert not re.search(r"joint_?\d|theta_?\d", field.name), f"{message.name}.{field.name}"
                if field.name in {"joints", "lower", "upper", "park", "joint_names"}:
                    assert field.is_repeated
