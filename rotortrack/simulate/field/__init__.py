"""The field, the flow and the salt around a charged nanopore in a membrane."""
