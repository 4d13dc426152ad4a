// SPDX-License-Identifier: Apache-2.0
#pragma once

// GCC says it by macros, clang by features.
#ifndef __has_feature
#define __has_feature(x) 0
#endif

namespace envbake::test {

#if defined(__SANITIZE_ADDRESS__) || __has_feature(address_sanitizer)
inline constexpr bool kAddressSanitizer = true;
#else
inline constexpr bool kAddressSanitizer = false;
#endif
#if defined(__SANITIZE_THREAD__) || __has_feature(thread_sanitizer)
inline constexpr bool kThreadSanitizer = true;
#else
inline constexpr bool kThreadSanitizer = false;
#endif

}  // namespace envbake::test
