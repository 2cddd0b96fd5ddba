"""The errors of calls, by the statuses of quarry.h."""


class Error(Exception):
    """A call failed; the text is one sentence."""


class ArgumentError(Error, ValueError):
    """An argument cannot be; the sentence names it, and the index of a ray."""


class SourceError(Error, OSError):
    """A file or a server cannot be read now; a later call tries again."""


class DataError(Error):
    """No store, another version, or damaged."""


class CancelledError(Error):
    """Scene.cancel() or Scene.close(), from another thread."""


class ProcessorError(Error):
    """The processor lacks AVX2, FMA and BMI2."""


class ForkedError(Error):
    """The scene was opened before a fork, by the parent process."""


BY_STATUS = {1: ArgumentError, 2: SourceError, 3: DataError, 4: MemoryError, 5: CancelledError, 6: ProcessorError, 7: ForkedError}
