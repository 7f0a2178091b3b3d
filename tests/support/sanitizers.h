// Defines NERF_SANITIZED where AddressSanitizer or ThreadSanitizer is compiled in: they reserve
// terabytes of address space and take memory of their own, so that nothing about memory can be
// tested.
#pragma once

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define NERF_SANITIZED
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define NERF_SANITIZED
#endif
#endif
