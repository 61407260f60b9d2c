"""Watches the dynamics node by its commands; decides when the guard takes over."""

from kane_dynamics.control_cycle.arbitration import LOST
from kane_dynamics.ros.common.conversion import Array
import numpy as np

UNANSWERED = 2      # states without a command before a takeover: one may be lost
# S; after a longer stall of the guard the node may have given up on it
OWN_STALL = 0.03
# Of the lease, after which a loss of liveliness counts; DDS rounds down
SHARE = 0.9


class NodeWatch:
    """
    Decides which process commands.

    The guard takes over if torques act, `lease` has passed since the last command of the
    node, and two valid states were received since then. All times are of
    `time.perf_counter`, s.

    A guard that was stopped for longer than `LOST` counted as dead meanwhile, and
    another guard may hold the arm now, from torques that this one does not know. It
    therefore listens for `LOST`, silently, before it takes over again.

    Parameters
    ----------
    lease : float
        Parameter guard.lease, s.
    joints : int

    Attributes
    ----------
    armed : bool
        Whether the last torque is not zero.
    known : bool
        Whether the node knows of the guard; before, the guard never takes over.
    acting : bool
        Whether the guard commands.
    torque : (n,) array
        The last torque, of the node or of the guard, N m or N.
    commanded_last : bool
        Whether the guard commanded it.
    takeovers : int
        Number of takeovers since the start.
    waiting_since : float
        Time of `heard_at`, or of the end of a stall of the guard.
    heard_at : float
        Time of the last command or request of the node.
    silent_for : float
        Time since the last command of the node at the last takeover, s.
    stopped_for : float
        Duration of the last stop of this process, s; zero once it was reported.

    """

    def __init__(self, lease: float, joints: int) -> None:
        self._lease = lease
        self.armed = self.acting = self.commanded_last = self.known = False
        self.torque = np.zeros(joints)
        self.takeovers = self._unanswered = 0
        self.silent_for = self.stopped_for = 0.0
        self.waiting_since = self.heard_at = 0.0
        self._alive = 0.0  # time of the last sign of life of the guard itself; 0: none
        self._listens_until = 0.0

    @property
    def holding(self) -> bool:
        """Return whether a torque of the guard acts."""
        return self.acting or (self.commanded_last and self.armed)

    def note_node_command(self, torque: Array, now: float) -> None:
        """Note a command of the node."""
        self.note(torque, False)
        self.wait_for_node(now)

    def note(self, torque: Array, own: bool) -> None:
        """Note a command of the node or of the guard."""
        self.torque = torque
        self.armed = bool(torque.any())
        self.commanded_last = own

    def wait_for_node(self, now: float) -> None:
        """Leave the command to the node, which was heard now."""
        self.heard_at = now
        self._wait(now)

    def _wait(self, now: float) -> None:
        """Wait for the node as if it had commanded now."""
        self.acting = False
        self._unanswered = 0
        self.waiting_since = now

    def tick(self, now: float) -> None:
        """
        Note that the guard runs, several times in a lease.

        After a stall of its own, wait.
        """
        first = self._alive == 0.0
        stall = now - self._alive
        self._alive = now
        if stall > (OWN_STALL if self.acting else self._lease):
            self._wait(now)  # messages of the node may still be in the queue
        if stall > LOST and not first:
            self.stopped_for = stall
            self._listens_until = now + LOST

    def listens(self, now: float) -> bool:
        """Return whether this guard was stopped and still listens for another one."""
        return now < self._listens_until

    def may_take_over(self, now: float) -> bool:
        """Return whether there is a torque to hold that no other guard may hold."""
        return self.armed and self.known and not self.acting and not self.listens(now)

    def may_command(self, now: float) -> bool:
        """Count a valid state; return whether the guard commands."""
        self.tick(now)
        if not self.acting:
            self._unanswered += 1
            self.check(now)
        return self.acting

    def may_repeat(self, now: float) -> bool:
        """Return whether the guard commands; a refused state does not count."""
        self.tick(now)
        return self.acting

    def confirm(self, now: float) -> bool:
        """Return whether the guard still commands."""
        return self.acting and now - self._alive < OWN_STALL

    def check(self, now: float, lost: bool = False) -> None:
        """
        Command if the lease has expired, states are not answered and torques act.

        `lost` says that DDS reports the loss of liveliness, with its own measure of the
        lease.
        """
        share = SHARE if lost else 1.0
        expired = self.silent(now, share) and self._unanswered >= UNANSWERED
        if expired and self.may_take_over(now):
            self.take_over(now)

    def silent(self, now: float, share: float = 1.0) -> bool:
        """Return whether the node was not heard for a share of the lease."""
        return now - self.waiting_since > share * self._lease

    def take_over(self, now: float) -> None:
        """Command from the next state on."""
        self.acting = True
        self.silent_for = now - self.waiting_since
        self.takeovers += 1
