"""Print a shell completion script.

plumb completion bash > ~/.local/share/bash-completion/completions/plumb
plumb completion zsh  > a file named _plumb in a folder of your fpath
"""

from __future__ import annotations

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh"))


def main(arguments: argparse.Namespace) -> int:
    import shtab

    from plumb.cli.verbs import command_module, commands

    whole = argparse.ArgumentParser(prog="plumb")
    verbs = whole.add_subparsers()
    for name, text in commands().items():
        module = command_module(name)
        module.add_arguments(verbs.add_parser(name, help=text))
    print(shtab.complete(whole, shell=arguments.shell))
    return 0
