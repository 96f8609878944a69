"""`python -m calibkit`, and the command of that name, are the command line."""

import gc


def main() -> None:
    """Run the command line on the arguments of the process."""
    # nothing that an import makes is garbage: to look for some is a tenth of what `--help` takes
    gc.disable()
    from calibkit.cli import main as run

    gc.freeze()
    gc.enable()
    try:
        run()
    finally:
        # the process ends: to look for garbage among all that was imported would take longer than
        # `--help`
        gc.freeze()


if __name__ == "__main__":
    main()
