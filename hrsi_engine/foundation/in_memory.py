"""Names of things that a program has in memory, where others name a file: the thing goes with its name."""


class InMemory(str):
    """The name of something in memory, for messages and reports; what it stands for is an attribute of the subclass.

    So an option that names a file also takes the thing itself, and everything between the caller and the reader
    passes it on as it passes the name of a file.
    """

    __slots__ = ()
