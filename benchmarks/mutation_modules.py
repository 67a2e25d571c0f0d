"""The modules that a mutation run changes, each with the tests that should notice."""

VALIDATION = "tests/engine/stages/validation"
DIAGNOSIS = "tests/engine/stages/diagnosis"
MACROS = "tests/engine/stages/macros"
MODULES: dict[
    str, tuple[tuple[str, ...], tuple[str, ...]]
] = {  # files, tests from the quickest to the slowest
    "checker": (
        ("engine/stages/validation/*.py",),
        (
            *(
                f"{VALIDATION}/test_{name}.py"
                for name in (
                    "facts",
                    "aggregate_bounds",
                    "rules",
                    "false_claims",
                    "chains",
                    "semantics",
                    "datalog",
                    "precedence",
                )
            ),
            *(
                f"tests/properties/test_{name}.py"
                for name in ("plan_checker", "aggregates", "derived_atoms")
            ),
            "tests/engine/test_centrifuge.py",
            "tests/engine/pipelines/planning/test_kept_order.py",
        ),
    ),
    "deordering": (
        ("engine/stages/planning/improvement/plan_reordering.py",),
        ("tests/engine/stages/planning/test_deorder.py",),
    ),
    "schedule checker": (
        ("engine/stages/scheduling/checker.py",),
        (
            "tests/engine/stages/scheduling/test_checker.py",
            "tests/engine/stages/scheduling/test_checker_rules.py",
        ),
    ),
    "diagnosis": (
        ("engine/stages/diagnosis/*.py",),
        (
            *(
                f"{DIAGNOSIS}/test_{name}.py"
                for name in ("lookahead", "revision", "conversations", "knowledge", "circuits")
            ),
            *(
                f"{DIAGNOSIS}/test_{name}.py"
                for name in ("arrays", "later_advice", "searches", "trees", "session", "selection")
            ),
        ),
    ),
    "MACROP proof": (
        (
            "engine/stages/macros/learning/plan_proof.py",
            "engine/stages/macros/learning/proof_safety.py",
        ),
        (f"{MACROS}/test_figure_4.py", f"{MACROS}/test_proof.py", f"{MACROS}/test_generalise.py"),
    ),
    "checks of the knowledge base": (
        ("kb/check/*.py",),
        tuple(
            f"tests/kb/check/test_{name}.py"
            for name in (
                "fault_bases",
                "near_misses",
                "oversights",
                "domain_checks",
                "alike",
                "whole_domain",
            )
        ),
    ),
}
