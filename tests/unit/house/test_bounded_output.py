"""Programs of gateways take a bounded part of what others print: memory is not a stranger's to fill."""

import ast
from pathlib import Path

CHECKOUT = Path(__file__).parents[3]
PROGRAMS = (
    *sorted((CHECKOUT / "templates/gateway").glob("*.py")),
    *sorted((CHECKOUT / "templates/openvpn").glob("*.py")),
    *sorted((CHECKOUT / "roles").rglob("files/*.py")),
    *sorted((CHECKOUT / "atlantis_netcfg/checklist/probes/agent").glob("*.py")),
)
UNBOUNDED = {"capture_output", "check_output", "communicate", "getoutput"}


def test_gateway_programs_never_read_unbounded_output() -> None:
    assert len(PROGRAMS) > 8
    places = [
        f"{file.relative_to(CHECKOUT)}:{node.lineno}"
        for file in PROGRAMS
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and _is_unbounded(node)
    ]
    assert places == [], "read it as `bounded` of retrieval_robot.py does, with a limit and a deadline"


def _is_unbounded(node: ast.Call) -> bool:
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
    pipes = name == "run" and any(keywords.get(stream, "").endswith("PIPE") for stream in ("stdout", "stderr"))
    return name in UNBOUNDED or "capture_output" in keywords or pipes
