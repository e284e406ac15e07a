"""Who is at the other end of the control socket, and whether he may command."""

import grp
import os
import pwd
import socket
import struct
from dataclasses import dataclass

GROUP = "flightapp"
"""Whose members may command, besides root and the user that the service runs as."""
_CREDENTIALS = struct.Struct("3i")


@dataclass(frozen=True, slots=True)
class Peer:
    """A process at the other end, as the kernel knows it: it cannot pretend."""

    pid: int
    uid: int
    gid: int

    def __str__(self) -> str:
        try:
            return f"{pwd.getpwuid(self.uid).pw_name} (uid {self.uid})"
        except KeyError:
            return f"uid {self.uid}"


def peer_of(connection: socket.socket) -> Peer:
    """Who has connected, by SO_PEERCRED; raises OSError."""
    data = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    return Peer(*_CREDENTIALS.unpack(data))


def refusal(peer: Peer, group: str = GROUP) -> str:
    """Why ``peer`` may not command, with the mend; empty where he may."""
    if peer.uid in (0, os.geteuid()):
        return ""
    try:
        allowed = grp.getgrnam(group).gr_gid
    except KeyError:
        return f"{peer} may not command: there is no group '{group}' here, so only root and the service's user may"
    if allowed in _groups(peer):
        return ""
    return f"{peer} may not command: not in the group '{group}'; add with: sudo usermod -aG {group} NAME"


def _groups(peer: Peer) -> list[int]:
    try:
        user = pwd.getpwuid(peer.uid)
    except KeyError:
        return [peer.gid]
    return [peer.gid, *os.getgrouplist(user.pw_name, user.pw_gid)]
