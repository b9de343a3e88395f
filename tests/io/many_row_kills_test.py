# ranks: 2
# labels: long
# timeout: 900
"""As row_kill_test.py, hundreds of times."""

from row_kill import kill

if __name__ == "__main__":
    kill(400)
