"""What can go wrong, one class per thing that a caller can act on."""


class NurbsOocError(Exception):
    """Root of all errors this project raises; the message names file, entity, value and limit."""

    exit_code = 2


class InputFileError(NurbsOocError):
    """An input file is missing, unreadable, truncated or not what its name says."""


class UsageError(NurbsOocError):
    """An argument is out of range or contradicts another."""


class CacheError(NurbsOocError):
    """A cache is foreign, of another schema, locked by another build or cannot be written."""


class CorruptRecordError(CacheError):
    """A stored value is truncated or fails its checksum."""


class MissingRecordError(CacheError):
    """Nothing is stored under this key."""


class PromiseBrokenError(NurbsOocError):
    """The work was done, but a promised bound does not hold."""

    exit_code = 1


class WorkerDiedError(NurbsOocError):
    """A process that worked for this one has ended before its job was done."""

    exit_code = 1
