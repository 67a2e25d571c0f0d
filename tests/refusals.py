"""Command lines that are refused with a code of their own: no example folder can show these codes.

`{plan}` is a plan for bulkhead/one_point, `{other}` is a file with other content, `{folder}` is a
folder with files in it. `{store}` is a library, `{closed}` is a folder that does not exist,
`{bare}` is a domain with nothing but operators, and `{problem}` is a problem with one measurement.
"""

REFUSALS = {
    "K403": ["init {folder}"],
    "K404": [
        "explain bulkhead",
        "sequence bulkhead",
        "measurement list themse",
        "diagnose bulkhead --exception no_echo --recover",
        "export bt themse/one",
    ],
    "K405": [
        "diagnose {bare} --exception any",
        "states {bare}",
        "cell show {bare}",
        "sequence {bare}/problem.yaml",
    ],
    "K406": [
        "plan bulkhead/one_point --strategy asap",
        "sequence bulkhead/one_point --method exakt",
        "import qif {folder}/points.csv --unit ft",
        "schedule {folder}/shops.json --instance c",
    ],
    "K407": ["plan", "plan a --nosuch", "nosuch"],
    "K408": [
        "plan a --race --strategy asp",
        "schedule {plan} --goals x",
        "schedule bulkhead/one_point --instance x",
    ],
    "K409": [
        "plan bulkhead/one_point --goals x --command y",
        "diagnose bulkhead --history",
        "schedule {folder}/shops.json",
    ],
    "K410": ["explain {plan} 99", "revise {plan} --done 99"],
    "K411": ["diagnose bulkhead/one_point --exception no_echo --plan {plan} --done 2"],
    "K412": ["diagnose bulkhead/twelve_points --exception no_echo --plan {plan} --done 1"],
    "K413": [
        "macros import {other} --store {store}",
        "diagnose bulkhead --import {other} --store {store}",
    ],
    "K415": ["macros export {closed}/a.json --store {store}"],
    "K416": [
        "macros list --store {other}",
        "macros list --store {closed}/a.db",
        "macros list --store x://y",
    ],
    "K417": ["macros show 7 --store {store}"],
    "K418": ["measurement remove {problem} m1"],
    "K421": [
        "resume none --store {store}",
        "stop none",
        "run themse/one --store {store} --fault 3",
    ],
    "K906": ["diagnose bulkhead --exception no_echo --step tidy"],
    "K907": ["diagnose bulkhead --exception no_echo --outcomes look_at_spot=wet,look_at_spot=dry"],
}

ENVIRONMENT = (
    "K414",
    "K419",
    "K420",
    "K422",
    "K425",
    "K430",
)  # what is missing: a package, memory, time, a sound library, a controller, a cluster
