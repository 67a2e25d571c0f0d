"""The monitor in the browser: runs that go on and runs that are past, read from their journals, and
steered through their sockets.

`following` reads a journal and folds its records, `charts` draws, `door` decides who may ask for
what, `page` shows, and `serving` puts them together. Everything is built with NiceGUI (the extra
`monitor`), whose files come from the installed package.
"""
