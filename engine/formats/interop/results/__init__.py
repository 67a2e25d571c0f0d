"""Results of runs as CSV, JSON and QIF Results. What is written is read back equal."""

from enum import StrEnum

from cellwright.engine.formats.interop.results.json_and_csv import (
    read_csv,
    read_json,
    written_csv,
    written_json,
)
from cellwright.engine.formats.interop.results.qif_results import read_qif, written_qif
from cellwright.kb.model.measured_results import Results


class ResultForm(StrEnum):
    """The forms in which results are exchanged."""

    CSV = "csv"
    JSON = "json"
    QIF = "qif"


def write_results(results: Results, form: ResultForm) -> str:
    """The results in a form.

    CSV and QIF have what was measured, JSON the history of each object, too.
    """
    return {
        ResultForm.CSV: written_csv,
        ResultForm.JSON: written_json,
        ResultForm.QIF: written_qif,
    }[form](results)


def read_results_text(text: str, form: ResultForm) -> Results:
    """The results in a text that `written` made. Raises `ValueError` for another text."""
    reader = {ResultForm.CSV: read_csv, ResultForm.JSON: read_json, ResultForm.QIF: read_qif}[form]
    try:
        return reader(text)
    except (LookupError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"not results: {error!r}") from error
