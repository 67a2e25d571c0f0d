"""What lies in the working folder comes before what is bundled, and is told when it cannot be
read.
"""

import shutil
from pathlib import Path

import pytest

from cellwright.engine.authoring import domain_check
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import bundled_domains, load
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.targets import find_target, problem_files


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of a bundled domain in the working folder."""
    shutil.copytree(bundled_domains()["bulkhead"], tmp_path / "bulkhead")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "bulkhead"


def test_a_problem_of_the_own_domain_is_found(own: Path) -> None:
    assert (
        find_target("bulkhead/one_point").resolve()
        == (own / "problems" / "one_point.yaml").resolve()
    )
    (own / "problems" / "one_point.yaml").unlink()
    with pytest.raises(InvalidInput, match=r"K401.*has no such problem"):
        find_target("bulkhead/one_point")


@pytest.mark.parametrize("kind", ["folder", "dangling"])
def test_an_unreadable_domain_is_not_replaced_by_the_bundled_one(own: Path, kind: str) -> None:
    file = own / "domain.yaml"
    file.unlink()
    if kind == "folder":
        file.mkdir()
    else:
        file.symlink_to("/nowhere")
    for target in ("bulkhead", "bulkhead/one_point"):
        with pytest.raises(InvalidInput, match=r"K001|K401"):
            load(find_target(target))


def test_problems_that_are_no_folder_are_told(own: Path) -> None:
    shutil.rmtree(own / "problems")
    assert problem_files(own / "domain.yaml") == []
    (own / "problems").write_text("")
    assert "K001" in {
        each.code for each in domain_check.check_domain_files("bulkhead", reach=False).diagnostics
    }


@pytest.mark.parametrize("name", ["faults.yaml", "cell.yaml", "contacts.yaml"])
def test_a_file_beside_the_domain_that_leads_nowhere_is_told(own: Path, name: str) -> None:
    (own / name).unlink(missing_ok=True)
    (own / name).symlink_to("/nowhere")
    assert "K001" in {
        each.code for each in domain_check.check_domain_files("bulkhead", reach=False).diagnostics
    }


@pytest.mark.parametrize("key", ["model", "urdf"])
@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../secret.yaml", "inside/../../secret.yaml", "link.yaml"]
)
def test_a_cell_reads_nothing_outside_its_folder(tmp_path: Path, key: str, name: str) -> None:
    (tmp_path / "cell").mkdir()
    (tmp_path / "secret.yaml").write_text("password: 12345\n")
    (tmp_path / "cell" / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    (tmp_path / "cell" / "inside").mkdir()
    file = tmp_path / "cell" / "cell.yaml"
    file.write_text(f"cell: c\narms:\n  arm:\n    {key}: {name}\n")
    with pytest.raises(InvalidInput) as refused:
        load_cell(file)
    assert "K203" in {each.code for each in refused.value.diagnostics}
    assert "12345" not in str(refused.value) + "".join(
        "".join(each.where.excerpt()) for each in refused.value.diagnostics
    )
