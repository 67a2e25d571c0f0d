"""What a shell completes: the names of targets, and files."""

from collections.abc import Iterator
from pathlib import Path

KINDS = (".yaml", ".yml", ".json", ".tsp", ".pddl")


def targets(incomplete: str) -> list[str]:
    """Bundled domains and problems, and files and folders, that begin like this."""
    from cellwright.kb.targets import bundled

    names = [name for domain, folder in bundled().items() for name in (domain, *_problems(domain, folder))]
    return [*(each for each in names if each.startswith(incomplete)), *files(incomplete)]


def files(incomplete: str) -> list[str]:
    """Files that can be a target, and folders, that begin like this."""
    path = Path(incomplete)
    folder = path if incomplete.endswith("/") else path.parent
    try:
        found = sorted(folder.iterdir())
    except OSError:
        return []
    shown = (f"{each}/" if each.is_dir() else str(each) for each in found if not each.name.startswith("."))
    return [each for each in shown if each.startswith(incomplete) and each.endswith(("/", *KINDS))]


def scenes(incomplete: str) -> list[str]:
    """Bundled scenes, and files, that begin like this."""
    from cellwright.kb.targets import bundled_scenes

    return [*(each for each in bundled_scenes() if each.startswith(incomplete)), *files(incomplete)]


def devices(incomplete: str) -> list[str]:
    """Devices that begin like this; of a list with commas, the last of them."""
    from cellwright.kb.targets import bundled_devices

    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{each}" for each in bundled_devices() if each.startswith(last)]


def runs(incomplete: str) -> list[str]:
    """Runs of the user's own journal that begin like this, the last ones first."""
    from cellwright.kb.diagnostics import InvalidInput
    from cellwright.kb.store.journal import Journal
    from cellwright.kb.store.own import default_store

    try:
        with Journal(default_store()) as journal:
            names = [each.run for each in journal.begun()]
    except InvalidInput:
        return []
    return [each for each in reversed(names) if each.startswith(incomplete)]


def _problems(domain: str, folder: Path) -> Iterator[str]:
    for each in sorted([*folder.glob("problems/*.yaml"), *folder.glob("large/*.yaml")]):
        yield f"{domain}/{each.stem}"
