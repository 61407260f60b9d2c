"""Count messages that are lost because node or network is too slow for them."""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

WARNING_SHARE = 0.05  # of the messages of a reporting period


def with_info(callback: Callable[[Any, Any], None]) -> Callable[..., None]:
    """
    Return a subscription's callback of a message and its info, for every executor.

    The EventsExecutor of some releases of rclpy (such as 7.1) passes both as one tuple,
    other executors as two arguments. rclpy passes the info because `callback` has two
    parameters.
    """
    @wraps(callback)
    def call(*given: Any) -> None:
        callback(*(given if len(given) == 2 else given[0]))
    return call


class LostMessages:
    """
    Counts lost messages of one publisher by the sequence numbers that are missing.

    Attributes
    ----------
    total : int
        Number of lost messages.
    numbered : bool
        Whether the middleware numbers messages; no loss can be counted otherwise.

    """

    def __init__(self) -> None:
        self.total = 0
        self.numbered = True
        self._received = self._last = 0
        self._reported = 0, 0

    def note(self, info: Mapping[str, Any]) -> None:
        """
        Note one received message.

        A restarted publisher numbers its messages from 1 again.
        """
        number = info['publication_sequence_number']
        if number is None:
            self.numbered = False
            return
        # A number that does not follow the last one is a loss; numbers of a new
        # publisher begin again.
        self._received += 1
        if 0 < self._last < number:
            self.total += number - self._last - 1
        self._last = number

    def note_number(self, number: int) -> None:
        """Note one received message by its number; negative without one."""
        self.note({'publication_sequence_number': None if number < 0 else number})

    def skip(self) -> None:
        """Forget the last message: messages before the next noted one do not count as lost."""
        self._last = 0

    def period(self, publishers: int) -> tuple[float, str]:
        """
        Close a reporting period and return its figures.

        Parameters
        ----------
        publishers : int
            Number of publishers on the topic. Of several, the numbers are not
            comparable, and the losses of the period are not counted.

        Returns
        -------
        share : float
            Share of the messages of this period that were lost; 0 if unknown.
        figure : str
            Number of messages lost so far, or why it is unknown.

        """
        total = self.total
        received = self._received
        # With several publishers, their numbers mix: nothing follows from them.
        lost = total - self._reported[0]
        if publishers > 1:
            self.total = total = self._reported[0]
            lost = 0
        share = lost / max(1, lost + received - self._reported[1])
        self._reported = total, received
        if not self.numbered:
            return 0.0, 'unknown: the middleware does not number messages'
        return share, (f'{total}, now unknown: several publishers' if publishers > 1
                       else str(total))
