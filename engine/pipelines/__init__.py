"""What joins the stages: each pipeline leads from one kind of question to its answer."""
