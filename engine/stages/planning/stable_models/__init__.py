"""Planning in answer set programming: plans as stable models."""
