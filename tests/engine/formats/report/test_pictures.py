import re
from collections.abc import Iterator
from itertools import combinations, pairwise
from random import Random
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.report.drawing import dot_graphs, plan_svg
from cellwright.engine.formats.report.drawing.graph_layout import layout_graph
from cellwright.engine.formats.report.drawing.plan_svg import MAX_COLUMN_STEPS, split_columns
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load_problem
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, Plan, Step, StepId
from cellwright.kb.terms import Function

SVG = "{http://www.w3.org/2000/svg}"
Box = tuple[float, float, float, float]  # left, top, right, bottom
Segment = tuple[float, float, float, float]  # the same


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    """Plans of up to twelve steps with random orders, links and resources."""
    count = draw(st.integers(0, 12))
    steps, links = [], []
    for number in range(1, count + 1):
        earlier = st.integers(1, number - 1) if number > 1 else st.nothing()
        after = draw(st.lists(earlier, unique=True, max_size=3)) if number > 1 else []
        name = draw(st.text("abc<&>'\"", min_size=1, max_size=20))
        held = draw(st.lists(st.sampled_from([Function("arm"), Function("<tool>")]), unique=True))
        steps.append(
            Step(StepId(number), Function(name), tuple(map(StepId, sorted(after))), tuple(held))
        )
        for producer in draw(st.lists(st.integers(0, number - 1), unique=True, max_size=6)):
            condition = Function("p<&", (Function(draw(st.sampled_from("qrstuvwx"))),))
            links.append(CausalLink(StepId(producer), condition, StepId(number)))
    links.append(
        CausalLink(
            StepId(draw(st.integers(0, count))) if count else INITIAL_STEP, Function("g"), GOAL_STEP
        )
    )
    return Plan(tuple(steps), tuple(links))


def drawn_in(
    root: ElementTree.Element, kind: str
) -> Iterator[tuple[ElementTree.Element, float, float]]:
    """The elements of a kind, and how far their column is moved to the right and down."""
    columns = [each for each in root.iter(f"{SVG}g") if each.get("class") == "column"]
    inside = {id(each) for column in columns for each in column.iter()}
    for each in root.iter(f"{SVG}{kind}"):
        if id(each) not in inside:
            yield each, 0.0, 0.0
    for column in columns:
        right, down = map(float, re.findall(r"-?[\d.]+", column.get("transform", "")))
        for each in column.iter(f"{SVG}{kind}"):
            yield each, right, down


def rectangles(root: ElementTree.Element, name: str) -> list[Box]:
    found = []
    for rect, right, down in drawn_in(root, "rect"):
        if rect.get("class") == name:
            x, y, width, height = (
                float(rect.get(key, "0")) for key in ("x", "y", "width", "height")
            )
            found.append((x + right, y + down, x + right + width, y + down + height))
    return found


def overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def ways(root: ElementTree.Element) -> list[tuple[str, list[Segment]]]:
    """Producer and condition of each link, and the level and upright pieces of its way."""
    found = []
    for path, right, down in drawn_in(root, "path"):
        if (path.get("class") or "").split(" ")[0] == "link":
            numbers = [float(number) for number in re.findall(r"-?[\d.]+", path.get("d", ""))]
            corners = [
                (x + right, y + down) for x, y in zip(numbers[::2], numbers[1::2], strict=True)
            ]
            pieces = [
                (min(x, to_x), min(y, to_y), max(x, to_x), max(y, to_y))
                for (x, y), (to_x, to_y) in pairwise(corners)
            ]
            title = path.findtext(f"{SVG}title") or ""
            found.append((title.rsplit(" for ", 1)[0], pieces))
    return found


@given(plans())
@settings(max_examples=50, deadline=None)
def test_an_svg_shows_every_step_order_and_link(plan: Plan) -> None:
    root = ElementTree.fromstring(plan_svg.draw_plan(plan))
    shown = [text.text or "" for text in root.iter(f"{SVG}text")]
    for step in plan.steps:
        assert f"{step.id} {step.operator}" in shown
    drawn = [path.get("class") for path in root.iter(f"{SVG}path")]
    assert drawn.count("order") == len(list(dot_graphs.direct_orders(plan)))
    assert drawn.count("link") + drawn.count("link given") == len(plan.links)
    texts = {
        INITIAL_STEP: "start",
        **{step.id: f"{step.id} {step.operator}" for step in plan.steps},
        GOAL_STEP: "goal",
    }
    titles = [title.text for path in root.iter(f"{SVG}path") for title in path.iter(f"{SVG}title")]
    assert titles == [
        f"{texts[link.producer]} achieves {link.condition} for {texts[link.consumer]}"
        for link in plan.links
    ]


@given(plans())
@settings(max_examples=50, deadline=None)
def test_boxes_and_labels_lie_on_the_paper_and_apart(plan: Plan) -> None:
    root = ElementTree.fromstring(plan_svg.draw_plan(plan))
    paper, *labels = rectangles(root, "paper")
    boxes = rectangles(root, "box")
    assert len(boxes) == len(plan.steps) + 2
    for one in (*boxes, *labels):
        assert paper[0] <= one[0] < one[2] <= paper[2]
        assert paper[1] <= one[1] < one[3] <= paper[3]
    for one, other in combinations([*boxes, *labels], 2):
        assert not overlap(one, other)


@pytest.mark.slow
@given(plans())
@settings(max_examples=200, deadline=None)
def test_no_link_runs_through_a_box_and_links_of_different_conditions_never_lie_on_one_another(
    plan: Plan,
) -> None:
    root = ElementTree.fromstring(plan_svg.draw_plan(plan))
    drawn = ways(root)
    for _, pieces in drawn:
        for left, top, right, bottom in pieces:
            assert left == right or top == bottom
            for box in rectangles(root, "box"):
                assert not overlap((left - 1e-9, top, right + 1e-9, bottom), box) or bottom in (
                    box[1],
                    box[3],
                )
    for (net, pieces), (other_net, others) in combinations(drawn, 2):
        if net != other_net:
            for left, top, right, bottom in pieces:
                for other in others:
                    level = (
                        top == bottom == other[1] == other[3]
                        and left < other[2]
                        and other[0] < right
                    )
                    upright = (
                        left == right == other[0] == other[2]
                        and top < other[3]
                        and other[1] < bottom
                    )
                    assert not level
                    assert not upright


@given(plans())
@settings(max_examples=50, deadline=None)
def test_a_link_ends_at_the_boxes_of_its_producer_and_its_consumer(plan: Plan) -> None:
    root = ElementTree.fromstring(plan_svg.draw_plan(plan))
    names = [INITIAL_STEP, *(step.id for step in plan.steps), GOAL_STEP]
    boxes = dict(zip(names, rectangles(root, "box"), strict=True))
    for link, (_, pieces) in zip(plan.links, ways(root), strict=True):
        producer, consumer = boxes[link.producer], boxes[link.consumer]
        assert producer[0] < pieces[0][0] < producer[2]
        assert pieces[0][1] == producer[3]
        assert consumer[0] < pieces[-1][0] < consumer[2]
        assert pieces[-1][3] == consumer[1]


@given(plans())
@settings(max_examples=50, deadline=None)
def test_every_order_points_downwards(plan: Plan) -> None:
    edges = list(dot_graphs.direct_orders(plan))
    nodes = [INITIAL_STEP, *(step.id for step in plan.steps), GOAL_STEP]
    placed = layout_graph(dict.fromkeys(nodes, 10.0), edges, 5.0)
    assert all(placed.layer[earlier] < placed.layer[later] for earlier, later in edges)


@given(plans())
@settings(max_examples=50, deadline=None)
def test_dot_has_one_edge_per_order_and_link(plan: Plan) -> None:
    edges = re.findall(r"^  \w+ -> \w+( \[.*\])?;$", dot_graphs.plan_dot(plan), flags=re.MULTILINE)
    assert len([edge for edge in edges if not edge]) == len(list(dot_graphs.direct_orders(plan)))
    assert len([edge for edge in edges if edge]) == len(plan.links)


@given(plans())
@settings(max_examples=10, deadline=None)
def test_pictures_repeat(plan: Plan) -> None:
    assert plan_svg.draw_plan(plan) == plan_svg.draw_plan(plan)
    assert dot_graphs.plan_dot(plan) == dot_graphs.plan_dot(plan)


def test_quotes_and_backslashes_stay_inside_the_strings_of_dot() -> None:
    operator = Function('say("a \\"b\\" \\\\n")')
    made = dot_graphs.plan_dot(Plan((Step(StepId(1), operator, (), (Function('"held"'),)),)))
    (label,) = re.findall(r'^  1 \[label="((?:[^"\\]|\\.)*)"\];$', made, flags=re.MULTILINE)
    assert re.sub(r'\\(["\\])', r"\1", label.replace(r"\n[", "\n[")) == f'1 {operator}\n["held"]'


def test_stages_are_shown_in_the_words_of_the_problem() -> None:
    problem = load_problem("themse/one")
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    assert any(link.condition.name == "_stage" for link in outcome.plan.links)
    for picture in (
        plan_svg.draw_plan(outcome.plan, problem),
        dot_graphs.plan_dot(outcome.plan, problem),
    ):
        assert "_stage" not in picture
        assert "heated(probe_1, 900)" in picture


@given(st.integers(1, 4 * MAX_COLUMN_STEPS), st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_columns_hold_every_step_once_and_every_link_where_it_begins_and_ends(
    count: int, seed: int
) -> None:
    chance = Random(seed)
    steps = tuple(Step(StepId(n), Function(f"o{n}")) for n in range(1, count + 1))
    links = []
    for _ in range(3 * count):
        producer, consumer = sorted(chance.sample(range(count + 2), 2))
        condition = Function(chance.choice("pqr"))
        links.append(
            CausalLink(
                StepId(producer), condition, StepId(consumer) if consumer <= count else GOAL_STEP
            )
        )
    plan = Plan(steps, tuple(dict.fromkeys(links)))
    made = split_columns(plan, str)
    assert [step.id for column in made for step in column.part.steps] == [step.id for step in steps]
    assert max(len(column.part.steps) for column in made) <= MAX_COLUMN_STEPS
    texts = {
        INITIAL_STEP: "start",
        **{step.id: f"{step.id} {step.operator}" for step in steps},
        GOAL_STEP: "goal",
    }
    said = [
        part for column in made for title in column.titles.values() for part in title.split("; ")
    ]
    for link in plan.links:
        head = f"{texts[link.producer]} achieves {link.condition} for "
        users = [title.removeprefix(head).split(", ") for title in said if title.startswith(head)]
        assert any(texts[link.consumer] in each for each in users)
    picture = ElementTree.fromstring(plan_svg.draw_plan(plan))
    assert len(rectangles(picture, "box")) == count + 2 * len(made)
    for one, other in combinations(rectangles(picture, "box"), 2):
        assert not overlap(one, other)
