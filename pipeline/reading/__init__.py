"""One guarded reader for each kind of file that the project takes from others, and that its stages hand each other.

Every reader opens regular files alone, bounds what is unpacked before it is unpacked, and raises one InputError with
what, where, expected and remedy for a file that is missing, damaged or of another kind (docs/safety.md).
"""
