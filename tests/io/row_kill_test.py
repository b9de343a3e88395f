# ranks: 2
"""A writer killed at a random moment leaves the rows it has marked."""

from row_kill import kill

if __name__ == "__main__":
    kill(16)
