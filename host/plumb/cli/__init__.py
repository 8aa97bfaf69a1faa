"""One module per verb: `add_arguments(parser)`, `main(arguments) -> exit code`; heavy imports inside `main`."""
