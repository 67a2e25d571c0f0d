"""Results of runs as CSV, JSON and QIF Results. What is written is read back equal."""

from enum import StrEnum

from cellwright.engine.formats.interop.results.notation import read_json, written_json
from cellwright.engine.formats.interop.results.qif import written_qif
from cellwright.engine.formats.interop.results.qif_reading import read_qif
from cellwright.engine.formats.interop.results.tables import read_csv, written_csv
from cellwright.kb.model.results import Results


class ResultForm(StrEnum):
    """The forms in which results are exchanged."""

    CSV = "csv"
    JSON = "json"
    QIF = "qif"


def written(results: Results, form: ResultForm) -> str:
    """The results in a form. CSV and QIF have what was measured, JSON the history of each object, too."""
    return {ResultForm.CSV: written_csv, ResultForm.JSON: written_json, ResultForm.QIF: written_qif}[form](
        results
    )


def read(text: str, form: ResultForm) -> Results:
    """The results in a text that `written` made. Raises `ValueError` for another text."""
    reader = {ResultForm.CSV: read_csv, ResultForm.JSON: read_json, ResultForm.QIF: read_qif}[form]
    try:
        return reader(text)
    except (LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"not results: {error!r}") from error
