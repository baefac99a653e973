// SPDX-License-Identifier: BSD-3-Clause
// Preloaded: the thread of camera "cam2" hangs in its next wait, for good, once the file $HANG is
// there: a driver that never comes back.
#include <dlfcn.h>
#include <pthread.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <ctime>

extern "C" int pthread_cond_clockwait(pthread_cond_t* condition, pthread_mutex_t* mutex,
                                      clockid_t clock, const timespec* until) {
  static const auto real = reinterpret_cast<decltype(&pthread_cond_clockwait)>(
      dlsym(RTLD_NEXT, "pthread_cond_clockwait"));
  static const char* const hang = std::getenv("HANG");
  char name[16] = "";
  prctl(PR_GET_NAME, name);
  if (hang && std::strncmp(name, "cam2", 4) == 0 && access(hang, F_OK) == 0)
    while (true) pause();
  return real(condition, mutex, clock, until);
}
