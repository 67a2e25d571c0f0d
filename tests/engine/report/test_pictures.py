import re
import xml.etree.ElementTree as ElementTree

from hypothesis import given, settings
from hypothesis import strategies as st

from engine.report import dot, svg
from engine.report.layout import layout
from kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId
from kb.terms import Function

SVG = "{http://www.w3.org/2000/svg}"


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
        steps.append(Step(StepId(number), Function(name), tuple(map(StepId, sorted(after))), tuple(held)))
        producer = draw(st.integers(0, number - 1))
        links.append(CausalLink(StepId(producer), Function("p<&", (Function(str(number)),)), StepId(number)))
    links.append(CausalLink(StepId(draw(st.integers(0, count))) if count else START, Function("g"), GOAL))
    return Plan(tuple(steps), tuple(links))


@given(plans())
@settings(max_examples=50, deadline=None)
def test_an_svg_shows_every_step_order_and_link(plan: Plan) -> None:
    root = ElementTree.fromstring(svg.plan(plan))
    shown = [text.text or "" for text in root.iter(f"{SVG}text")]
    for step in plan.steps:
        assert f"{step.id} {step.operator}" in shown
    drawn = [path.get("class") for path in root.iter(f"{SVG}path")]
    assert drawn.count("order") == len(list(dot.orders(plan)))
    assert drawn.count("link") == len(plan.links)
    titles = [title.text or "" for path in root.iter(f"{SVG}path") for title in path.iter(f"{SVG}title")]
    assert all(any(str(link.condition) in title for title in titles) for link in plan.links)


@given(plans())
@settings(max_examples=50, deadline=None)
def test_no_boxes_overlap_and_all_lie_on_the_paper(plan: Plan) -> None:
    root = ElementTree.fromstring(svg.plan(plan))
    size = tuple(float(root.get(name, "0")) for name in ("width", "height"))
    boxes = [
        tuple(float(rect.get(name, "0")) for name in ("x", "y", "width", "height"))
        for rect in root.iter(f"{SVG}rect")
        if rect.get("class") == "box"
    ]
    assert len(boxes) == len(plan.steps) + 2
    for index, (x, y, width, height) in enumerate(boxes):
        assert x >= 0
        assert y >= 0
        assert x + width <= size[0] + 1
        assert y + height <= size[1] + 1
        for other_x, other_y, other_width, _ in boxes[:index]:
            assert y != other_y or x >= other_x + other_width or other_x >= x + width


@given(plans())
@settings(max_examples=50, deadline=None)
def test_every_order_points_downwards(plan: Plan) -> None:
    edges = list(dot.orders(plan))
    nodes = [START, *(step.id for step in plan.steps), GOAL]
    placed = layout(dict.fromkeys(nodes, 10.0), edges, 5.0)
    assert all(placed.layer[earlier] < placed.layer[later] for earlier, later in edges)


@given(plans())
@settings(max_examples=50, deadline=None)
def test_dot_has_one_edge_per_order_and_link(plan: Plan) -> None:
    edges = re.findall(r"^  \w+ -> \w+( \[.*\])?;$", dot.plan(plan), flags=re.MULTILINE)
    assert len([edge for edge in edges if not edge]) == len(list(dot.orders(plan)))
    assert len([edge for edge in edges if edge]) == len(plan.links)


@given(plans())
@settings(max_examples=10, deadline=None)
def test_pictures_repeat(plan: Plan) -> None:
    assert svg.plan(plan) == svg.plan(plan)
    assert dot.plan(plan) == dot.plan(plan)
