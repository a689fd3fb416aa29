"""Pictures of the documents that are drawn, not measured."""
