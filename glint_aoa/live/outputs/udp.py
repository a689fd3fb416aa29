"""Readings as JSON datagrams."""

import contextlib
import socket
from typing import Any

from glint_aoa.errors import InputError
from glint_aoa.live.outputs.queued import Sender
from glint_aoa.live.readings import Reading

__all__ = ["UdpSender"]


class UdpSender(Sender):
    """Sends each reading as one UDP datagram that holds a line of JSON.

    Whether anybody listens is not asked; datagrams may be lost on the way.

    Parameters
    ----------
    address : str
        ``HOST:PORT``; an IPv6 address stands in brackets.

    Raises
    ------
    InputError
        If it is no address, or the host is not known.
    """

    def __init__(self, address: str) -> None:
        host, colon, port = address.rpartition(":")
        if not (colon and host and port.isdigit() and 0 < int(port) < 65536):
            raise InputError(f"--udp {address}: expected HOST:PORT, such as 192.168.0.7:5005")
        try:
            found = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_DGRAM)
        except OSError as error:
            raise InputError(
                f"--udp {address}: the host is not known ({error.strerror}); check its name"
            ) from None
        family, kind, protocol, _, to = found[0]
        self._to: Any = to
        self.name = f"udp {address}"
        self._socket = socket.socket(family, kind, protocol)

    def send(self, reading: Reading) -> None:
        """Send one; that nobody listens, or no cable is in, is no error."""
        with contextlib.suppress(OSError):
            self._socket.sendto(reading.line(), self._to)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
