"""One module per peripheral of the STM32F103, named as in the reference manual."""
