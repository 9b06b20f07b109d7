"""A service whose answer takes longer than a callback may."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

Reply = Callable[[Any], None]


class DeferredService:
    """Hands each request on with a function that sends its answer, now or later.

    rclpy sends what a callback returns at once, and its events executor awaits no coroutine; so the
    one call with which the executor sends an answer is kept until there is one.

    Parameters
    ----------
    node : Node
    kind : type
        Service type.
    name : str
    accept : callable
        Called with the request, an empty response and the function that sends a response.
    """

    def __init__(
        self, node: Node, kind: Any, name: str, accept: Callable[[Any, Any, Reply], None]
    ) -> None:
        self._accept = accept
        self._request: Any = None
        self._service = node.create_service(kind, name, self._on_request)
        self._send = self._service.send_response
        setattr(self._service, "send_response", self._keep)  # noqa: B010 - shadows the method

    def _on_request(self, request: Any, response: Any) -> Any:
        self._request = request
        return response

    def _keep(self, response: Any, header: Any) -> None:
        self._accept(self._request, response, lambda answer: self._send(answer, header))
