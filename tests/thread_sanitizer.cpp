// SPDX-License-Identifier: BSD-3-Clause
// What ThreadSanitizer is told, where it looks (the preset tsan).
#ifdef __SANITIZE_THREAD__

/// GDAL, which OpenCV asks what a JPEG is, takes two locks of its own in both orders while it
/// starts.
extern "C" const char* __tsan_default_suppressions();
extern "C" const char* __tsan_default_suppressions() { return "deadlock:libgdal.so\n"; }

#endif
