"""Where a cluster is, and whether anybody answers there."""

import socket
from urllib.parse import urlsplit

from rt_controller.contract.errors import ConfigError, RtControllerError

CONNECT_S = 5.0


class UnreachableError(RtControllerError):
    """A cluster that does not answer, or that has nobody to work."""

    exit_code = 2


def host_and_port(address: str) -> tuple[str, int]:
    """Of HOST:PORT, with or without a scheme in front.

    Raises:
        ConfigError: it is none.
    """
    try:
        parts = urlsplit(address if "://" in address else f"//{address}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or port is None:
        raise ConfigError(f"--address: expected HOST:PORT, found {address!r}.")
    return host, port


def require_listener(address: str) -> None:
    """Return if somebody listens there: known at once, where clusters' clients try for a minute.

    Raises:
        UnreachableError: nobody does.
    """
    try:
        socket.create_connection(host_and_port(address), timeout=CONNECT_S).close()
    except OSError as error:
        raise unreachable(address, "a cluster", error) from error


def unreachable(address: str, what: str, why: object) -> UnreachableError:
    """The error of an address at which `what` does not answer."""
    first_line = (str(why).strip() or type(why).__name__).splitlines()[0]
    return UnreachableError(
        f"--address {address}: expected {what} to answer, found none ({first_line}). Start it, or "
        f"name another HOST:PORT."
    )
