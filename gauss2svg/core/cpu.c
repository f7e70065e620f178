/* The level of x86-64 that this CPU has. */

#include "core.h"

#if defined(__x86_64__)
#include <cpuid.h>

/* Return the highest level, 2, 3 or 4, of x86-64 that the CPU and the operating system support. */
API int64_t cpu_level(void) {
    unsigned a, b, c, d, features = 0, low, high;
    __get_cpuid(1, &a, &b, &features, &d);
    const unsigned v3 = bit_FMA | bit_MOVBE | bit_OSXSAVE | bit_AVX | bit_F16C;
    if ((features & v3) != v3 || !__get_cpuid_count(7, 0, &a, &b, &c, &d))
        return 2;
    /* The bits of XCR0 say which registers the system keeps: of SSE and AVX, and of AVX-512. */
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    const unsigned of_v3 = bit_AVX2 | bit_BMI | bit_BMI2;
    const unsigned of_v4 = bit_AVX512F | bit_AVX512DQ | bit_AVX512CD | bit_AVX512BW | bit_AVX512VL;
    if ((b & of_v3) != of_v3 || (low & 0x6) != 0x6)
        return 2;
    return (b & of_v4) == of_v4 && (low & 0xe6) == 0xe6 ? 4 : 3;
}
#else
API int64_t cpu_level(void) { return 0; }
#endif
