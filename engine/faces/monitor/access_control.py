"""Who may ask the monitor for what: hosts, tokens, cookies; a repeated request acts once.

Only requests that name the address under which the monitor is served come in, so a page of another
site cannot reach it through a name of its own. Whatever changes something is a POST with the token
of the page and a key, and counts once. Beyond this machine, everything needs the token.
"""

import hmac
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

Scope = MutableMapping[str, Any]
Messages = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Messages, Send], Awaitable[None]]

TOKEN_COOKIE = "cellwright_token"
MAX_REMEMBERED_KEYS = 10_000  # keys of changing requests
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")


class AccessControl:
    """Lets requests through to `app`, or refuses them.

    `local` says that only this machine can reach the address.
    """

    def __init__(self, app: App, hosts: Iterable[str], token: str, local: bool) -> None:
        self.app, self._hosts = app, {host.lower() for host in hosts}
        self._token, self._local = token, local

    async def __call__(self, scope: Scope, receive: Messages, send: Send) -> None:
        """Answer a request, or a connection of a page."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1").lower(): value.decode("latin-1")
            for name, value in scope["headers"]
        }
        refused = self._refusal(scope, headers)
        if refused is None:
            await self.app(scope, receive, self._remembering(scope, send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": refused[1]})
        else:
            await _send_refusal(send, *refused)

    def _refusal(self, scope: Scope, headers: MutableMapping[str, str]) -> tuple[int, str] | None:
        """Why a request is refused, with the status code; None if it is not."""
        if headers.get("host", "").lower() not in self._hosts:
            return 421, "this address is not served here"
        origin = headers.get("origin")
        if origin is not None and _origin_site(origin) not in self._hosts:
            return 403, "requests from other sites are refused"
        if not self._local and not self._knows(scope, headers):
            return 401, "open the address with the token that the command printed"
        changes = scope["type"] == "http" and scope["method"] not in SAFE_METHODS
        if changes and not _same_secret(headers.get("x-cellwright-token", ""), self._token):
            return 403, "the token is missing or wrong: load the page again"
        return None

    def _knows(self, scope: Scope, headers: MutableMapping[str, str]) -> bool:
        said = [
            *self._asked(scope),
            _token_cookie(headers.get("cookie", "")),
            headers.get("x-cellwright-token", ""),
        ]
        return any(_same_secret(token, self._token) for token in said)

    def _asked(self, scope: Scope) -> list[str]:
        return parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [])

    def _remembering(self, scope: Scope, send: Send) -> Send:
        """`send`, with a cookie if the token was in the address, so that the page's files come,
        too.
        """
        if self._local or not any(_same_secret(token, self._token) for token in self._asked(scope)):
            return send

        async def sending(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                cookie = f"{TOKEN_COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                message["headers"] = [*message.get("headers", []), (b"set-cookie", cookie.encode())]
            await send(message)

        return sending


class IdempotencyCache:
    """Keys of changing requests that have been answered, with their answers: a request that
    comes again changes nothing.
    """

    def __init__(self) -> None:
        self._answers: OrderedDict[str, Any] = OrderedDict()

    def answer(self, key: str, make: Callable[[], Any]) -> Any:
        """The answer that the key has, or a new one."""
        if key not in self._answers:
            self._answers[key] = make()
            while len(self._answers) > MAX_REMEMBERED_KEYS:
                self._answers.popitem(last=False)
        return self._answers[key]


def _origin_site(origin: str) -> str:
    """The host and port of an origin; empty if it is none."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""


def _same_secret(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(), other.encode())


def _token_cookie(text: str) -> str:
    try:
        cookie = SimpleCookie(text).get(TOKEN_COOKIE)
    except CookieError:
        return ""
    return cookie.value if cookie else ""


async def _send_refusal(send: Send, status: int, why: str) -> None:
    body = why.encode()
    headers = [
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"content-length", str(len(body)).encode()),
    ]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
