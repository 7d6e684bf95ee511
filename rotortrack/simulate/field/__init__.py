"""The field around a charged nanopore: potential, ions and flow, solved or looked up."""
