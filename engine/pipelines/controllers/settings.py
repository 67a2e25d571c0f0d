"""The options of the driver `external`: where the controller is, and how long it may take."""

from collections.abc import Mapping

from cellwright.engine.pipelines.controllers.link import Patience, Place
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.numbers import NumberError, decimal, is_count

HINT = "give --option command='PROGRAM ...' or --option address=HOST:PORT"
SETTINGS = ("command", "address", "begin", "answer", "heartbeat", "reconnect")


def place_of(options: Mapping[str, str]) -> Place:
    """Where the controller is. Raises `InvalidInput`."""
    strange = next((each for each in options if each not in SETTINGS), None)
    if strange is not None:
        said = f"the driver `external` has no option '{strange}'"
        raise InvalidInput([Diagnostic(Source("--option"), "K406", said, f"one of {', '.join(SETTINGS)}")])
    command, address = options.get("command", ""), options.get("address", "")
    host, _, port = address.rpartition(":")
    if bool(command) == bool(address) or (address and not (host and is_count(port) and int(port) < 65536)):
        raise InvalidInput([Diagnostic(Source("--option"), "K409", "where is the controller?", HINT)])
    return Place(command, host, int(port or 0))


def patience_of(options: Mapping[str, str]) -> Patience:
    """How long the controller may take. Raises `InvalidInput`."""
    usual = Patience()
    try:
        begin, answer, beat, again = (
            decimal(options[name]) if name in options else seconds
            for name, seconds in (
                ("begin", usual.begin_s),
                ("answer", usual.answer_s),
                ("heartbeat", usual.heartbeat_s),
                ("reconnect", usual.reconnect_s),
            )
        )
    except NumberError as error:
        said = f"a number of seconds {error}"
        raise InvalidInput([Diagnostic(Source("--option"), "K406", said, "write answer=5")]) from None
    if not (0 < begin < 1e6 and 0 < answer < 1e6 and 0 < beat < 1e6 and 0 <= again < 1e6):
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K406", "a time must be more than 0 s", "give seconds")]
        )
    return Patience(begin, answer, beat, again)
