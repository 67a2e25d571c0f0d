"""How Sphinx makes a site of the pages in `docs`: `make site`.

Nothing in the site is fetched from anywhere.
"""

import re
from pathlib import Path

DOCS = Path(__file__).parents[1]
project = "Cellwright"
author = ""
copyright = "the Cellwright project, MIT licence"
extensions = ["myst_parser"]
root_doc = "index"
exclude_patterns = ["site"]
myst_heading_anchors = 4
myst_links_external_new_tab = False
highlight_language = "text"
html_theme = "furo"
html_title = "Cellwright"
html_static_path = ["static"]
html_css_files = ["pictures.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
suppress_warnings = ["misc.highlighting_failure"]  # fragments of YAML and ASP, as pages show them
LINK = re.compile(r"^- \[[^\]]*\]\(([\w/-]+)\.md\)$", re.MULTILINE)
CONTENTS = ("index", "decisions/index")  # pages whose lists of links are the navigation
FOLDER = re.compile(r"\[([^\]]*)\]\((schema)\)")


def setup(app):
    """Pages are plain Markdown; what only a site needs is added while they are read."""
    app.connect("source-read", prepared)
    return {"parallel_read_safe": True}


def prepared(_app, name, source):
    """Lists of pages become contents, links to a folder its files; examples lose labels."""
    text = FOLDER.sub(lambda found: f"{found[1]} ({files(found[2])})", source[0])
    text = re.sub(r"^```(yaml|prolog|python) [\w ]+$", r"```\1", text, flags=re.MULTILINE)
    source[0] = text + (contents(text) if name in CONTENTS else "")


def contents(text):
    """The sections of a page that lists pages, as the navigation of the site."""
    sections = re.findall(r"^## (.*)\n((?:(?!## ).*\n)*)", text, re.MULTILINE)
    return "".join(
        "\n".join(
            [
                "",
                "```{toctree}",
                ":hidden:",
                f":caption: {title}",
                "",
                *LINK.findall(body),
                "```",
                "",
            ]
        )
        for title, body in sections
    )


def files(folder):
    """Links to the files of a folder."""
    return ", ".join(
        f"[{file.name.partition('.')[0]}]({folder}/{file.name})"
        for file in sorted((DOCS / folder).iterdir())
    )
