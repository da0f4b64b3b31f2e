"""What went wrong, said once and in full."""


class InputError(Exception):
    """Bad input: the message names the file, the place in it, what is wrong and what would be right.

    The command line prints the message alone and ends with exit code 2.
    """


class PartError(Exception):
    """A part that is not ours failed or broke its contract while a run went on.

    The message names the part, the iteration and, where the part's own code raised, the lines of it that did. The
    command line prints it alone and ends with exit code 3.
    """


class StorageError(Exception):
    """A disk is full, or a file can no longer be written: the message names the file, why, and what has been kept.

    The command line prints it alone and ends with exit code 4.
    """
