"""uvicorn's HTTP protocol with two things it lacks: a bound on the head of a request, and problems as answers."""

from __future__ import annotations

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol

from handeye.server.access.limits import HEAD_BYTES, size
from handeye.server.problem import HeadTooLarge, Malformed, RequestError
from handeye.server.problem_responses import refuse


class BoundedProtocol(HttpToolsProtocol):
    """For `uvicorn.Config(http=…)`. What cannot be read as HTTP gets a problem and the end of the connection."""

    _in_head = True
    _heads = 0
    """That are complete."""
    _head = 0
    """Bytes of a head that came in other pieces than the one it began in."""

    def data_received(self, data: bytes) -> None:
        """The next piece of what the connection carries."""
        began_before, heads = self._in_head, self._heads
        super().data_received(data)
        if began_before and self._heads == heads:
            self._head += len(data)
            if self._head > HEAD_BYTES and not self.transport.is_closing():
                self._refuse(HeadTooLarge(f"Path and headers are larger than {size(HEAD_BYTES)}."))

    def on_headers_complete(self) -> None:
        """The head is complete."""
        self._in_head, self._heads = False, self._heads + 1
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        """The request is complete: what follows is the head of the next."""
        super().on_message_complete()
        self._in_head, self._head = True, 0

    def send_400_response(self, msg: str) -> None:
        """The answer to what is no HTTP request."""
        self._refuse(Malformed(f"{msg} The request line, a header or the length of the body is not HTTP/1.1."))

    def _refuse(self, error: RequestError) -> None:
        response = refuse(error)
        lines = [STATUS_LINE[error.status].rstrip()]
        lines += [name + b": " + value for name, value in [*response.raw_headers, (b"connection", b"close")]]
        self.transport.write(b"\r\n".join(lines) + b"\r\n\r\n" + bytes(response.body))
        self.transport.close()
