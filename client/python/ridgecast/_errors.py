"""Why a call failed. Each message says what is wrong and what would be right."""


class Error(Exception):
    """Any failure of this package."""


class Invalid(Error, ValueError):
    """The call itself is wrong: a number out of range, a name that does not exist."""


class Refused(Error):
    """The server refuses, a file cannot be used, or there is no such server."""


class Lost(Error, ConnectionError):
    """There is no connection, or the server came back with another world."""


class Timeout(Error, TimeoutError):
    """The server or another member did not answer in time."""
