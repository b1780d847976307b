// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/* The first words in the flash of a Cortex-M: where its stack begins, and where the C library does. */
typedef void (*word)(void);
void _start(void);
__attribute__((section(".vectors"), used)) static const word vectors[] = {(word)0x20004000, _start};
