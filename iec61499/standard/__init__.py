"""The standard blocks: event blocks of IEC 61499-1, functions of IEC 61131-3, timers and communication."""
