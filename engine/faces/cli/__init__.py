"""The command `cellwright`: start of the process; large modules load only when a verb needs
them.
"""

# `signal` takes milliseconds to load, in which Ctrl-C would print a traceback.
import _signal  # type: ignore[import-not-found]
import gc
import os


def main() -> None:
    """Run the command line.

    Before a verb begins and after it ends, Ctrl-C ends the process without a message.
    """
    _signal.signal(_signal.SIGINT, _signal.SIG_DFL)
    gc.set_threshold(400_000)  # rarely: few objects here refer to each other in circles
    # Plug-ins of pydantic are for whole applications: to find them, it reads about every package.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    from cellwright.engine.faces.cli.invocation import run_command_line

    run_command_line()


def __getattr__(name: str) -> object:
    """The typer application, made at the first access."""
    if name == "app":
        from cellwright.engine.faces.cli.typer_application import app

        return app
    raise AttributeError(name)
