"""Commands of `quad`."""
