"""Methods and streams: one typed constant each, checked against the `.proto` files when it is made."""

import re
from dataclasses import dataclass
from typing import Generic, Self, TypeVar

from google.protobuf.message import Message

Req = TypeVar("Req", bound=Message)
Res = TypeVar("Res", bound=Message)


class Closing:
    """What a `with` block closes at its end."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends it for good; closing twice is no error."""
        raise NotImplementedError


def key(cell: str, service: str, name: str) -> str:
    """The Zenoh key `handeye/<cell>/<service>/<name>`, service and name in snake case."""
    return f"handeye/{cell}/" + re.sub(r"\B(?=[A-Z])", "_", f"{service}/{name}").lower()


@dataclass(frozen=True)
class Method(Generic[Req, Res]):
    """One `rpc` of a `service` block; `progress` is the message that a long call reports while it runs.

    Raises TypeError when the `.proto` file says otherwise.
    """

    service: str
    name: str
    request: type[Req]
    response: type[Res]
    progress: type[Message] | None = None

    def __post_init__(self) -> None:
        file = self.request.DESCRIPTOR.file
        try:
            declared = file.pool.FindServiceByName(f"{file.package}.{self.service}").methods_by_name[self.name]
        except KeyError:
            raise TypeError(f"{file.package} declares no rpc {self}") from None
        if (declared.input_type, declared.output_type) != (self.request.DESCRIPTOR, self.response.DESCRIPTOR):
            raise TypeError(f"rpc {self} takes {declared.input_type.name} and returns {declared.output_type.name}")

    def __str__(self) -> str:
        return f"{self.service}.{self.name}"


@dataclass(frozen=True)
class Stream(Generic[Res]):
    """A stream of messages that a service publishes or takes; `urgent` ones overtake pictures on the way."""

    service: str
    name: str
    message: type[Res]
    urgent: bool = False

    def __str__(self) -> str:
        return f"{self.service}/{self.name}"
