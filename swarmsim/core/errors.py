"""What a person did wrong, said once and in full."""


class InputError(Exception):
    """Bad input: the message names the file, the place in it, what is wrong and what would be right.

    The command line prints the message alone and ends with exit code 2; no other exception type is
    meant for people.
    """
