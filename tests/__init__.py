# The tests' Python imports by paths from the project's root, as its C++ does: this makes `tests` this folder, whatever packages Python has.
