"""What an editor asks about the files of a domain: where names are declared and used, what fits
here, what a name is.

The strict loader says what is wrong; these modules answer also while a text is broken. So they do
not read the model of the loader: they keep an index of names over small pieces of each text (an
entry of YAML, a statement of ASP). After an edit only the pieces that changed are read anew.
"""
