"""What is known: the domain language, its files and its types. Computes nothing about robots; never imports `engine`."""
