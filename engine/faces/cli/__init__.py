"""The command `cellwright`: parse, call, print, exit. Heavy imports wait until a command needs them."""

import signal


def main() -> None:
    """Run the command line. Until a verb has begun, and when it has ended, Ctrl-C ends the process without a word."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from engine.faces.cli.command import run

    run()


def __getattr__(name: str) -> object:
    """The application is made when it is asked for."""
    if name == "app":
        from engine.faces.cli.command import app

        return app
    raise AttributeError(name)
