"""A drive's own word that its motor is off, which counts only where it was heard after the drive was told so."""


class OffWord:
    """What a drive says since it was last told to switch off.

    What arrived before that does not count, nor what had arrived by then and is looked at later.

    Attributes:
        says_off: Whether the newest that counts says that the motor is off; whether it is fresh is for who asks.
    """

    __slots__ = ("_told_ns", "says_off")

    def __init__(self) -> None:
        self.says_off = False
        self._told_ns: int | None = None

    def told(self, now_ns: int) -> None:
        """A drive that was on, or on the way there, is told to switch off."""
        self.says_off = False
        self._told_ns = now_ns

    def hear(self, received_ns: int, *, is_off: bool) -> None:
        """Take what the drive said, and when that arrived."""
        self.says_off = is_off and (self._told_ns is None or received_ns > self._told_ns)
