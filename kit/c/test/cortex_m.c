// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/* The first words in a Cortex-M's flash: the start of its stack, and the entry of the C library. */
typedef void (*word)(void);
void _start(void);
__attribute__((section(".vectors"), used)) static const word vectors[] = {(word)0x20004000, _start};
