"""One module per command: `add_arguments(parser)` and `main(arguments) -> exit code`. Slow imports are inside
`main`."""
