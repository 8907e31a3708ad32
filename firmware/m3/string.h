// The two functions of <string.h> that the core uses, for a compiler without a libc for ARM.
#ifndef CONTID_M3_STRING_H
#define CONTID_M3_STRING_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif
void* memset(void* to, int value, size_t size);
void* memcpy(void* to, const void* from, size_t size);
#ifdef __cplusplus
}
#endif

#endif
