"""Who may ask a server: where it listens, which hosts and origins it answers to, the token."""

import hmac
import ipaddress
import secrets
import socket
from dataclasses import dataclass, replace
from urllib.parse import urlsplit

from glint_aoa.errors import InputError

__all__ = ["Access"]

_LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")
_LEAST_TOKEN = 16  # characters: shorter ones can be tried out


@dataclass(frozen=True)
class Access:
    """Rules for every request, whatever it asks for.

    Attributes
    ----------
    address : str
        IP address to listen on.
    port : int
        The port that the server listens on.
    token : str or None
        What each request must know; None on localhost where none is asked for.

    Notes
    -----
    The name in the Host header must be the server's own. A page elsewhere whose name is made to
    resolve to this machine (DNS rebinding) comes with its own name and is refused. A request with
    an Origin must come from a page of the server itself, so no other page can use it or its
    websocket.
    """

    address: str
    port: int
    token: str | None

    @classmethod
    def of(cls, address: str, port: int, token: str | None) -> "Access":
        """Make the rules; beyond localhost a token is made up if none is given.

        Raises
        ------
        InputError
            If `address` is no IP address, or `token` is too short or cannot stand in a URL.
        """
        address = "127.0.0.1" if address == "localhost" else address
        try:
            is_loopback = ipaddress.ip_address(address).is_loopback
        except ValueError:
            raise InputError(
                f"--listen is {address}; give an IP address of this machine, or 0.0.0.0 for all"
            ) from None
        if token is not None and (len(token) < _LEAST_TOKEN or not _is_plain(token)):
            raise InputError(
                f"--token must be {_LEAST_TOKEN} or more letters, digits, - and _; "
                "leave it out to have one made"
            )
        if token is None and not is_loopback:
            token = secrets.token_urlsafe(24)
        return cls(address, port, token)

    @property
    def url(self) -> str:
        """Address of the server, with the token."""
        ip = ipaddress.ip_address(self.address)
        host = socket.gethostname() if ip.is_unspecified else _bracketed(self.address)
        query = "" if self.token is None else f"?token={self.token}"
        return f"http://{host}:{self.port}/{query}"

    @property
    def cookie(self) -> str:
        """Name of the cookie that carries the token; cookies do not tell ports apart."""
        return f"glint-aoa-{self.port}"

    def at(self, port: int) -> "Access":
        """Return the same rules for the port that the system gave."""
        return replace(self, port=port)

    def knows_host(self, host: str) -> bool:
        """Whether a Host header names this server."""
        try:
            parts = urlsplit(f"//{host}")
            name, port = (parts.hostname or "").rstrip("."), parts.port or 80
        except ValueError:
            return False
        has_more = parts.path or parts.query or parts.fragment or "@" in host
        if has_more or port != self.port:
            return False
        ip = ipaddress.ip_address(self.address)
        if ip.is_loopback:
            return _bracketed(name) in {*_LOOPBACK_NAMES, _bracketed(self.address)}
        if ip.is_unspecified:  # a name can be rebound, an address cannot
            own = {"localhost", socket.gethostname().lower(), socket.getfqdn().lower()}
            return name in own or _is_ip(name)
        return name == self.address.lower()

    def knows_origin(self, origin: str, host: str) -> bool:
        """Whether an Origin header names the page that `host` serves."""
        return origin.lower() == f"http://{host}".lower()

    def knows_token(self, given: str | None) -> bool:
        """Whether a token is the right one, compared in constant time; yes if none is asked for."""
        if self.token is None:
            return True
        return hmac.compare_digest((given or "").encode(), self.token.encode())


def _is_plain(token: str) -> bool:
    return token.isascii() and all(c.isalnum() or c in "-_" for c in token)


def _is_ip(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _bracketed(name: str) -> str:
    return f"[{name}]" if ":" in name else name
