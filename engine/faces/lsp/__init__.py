"""The language server: what an editor asks, over standard input and output.

`desk` keeps the texts, `findings` finds errors in processes of its own, `answers` and `edits`
answer from the index of `cellwright.kb.editing`, which also knows broken texts; `orders` plans,
runs and explains. It decides nothing about the language.
"""
