"""What recording reports when it cannot do its work."""


class RecordingError(Exception):
    """A log cannot be written as asked; the message says what, where and what to do."""
