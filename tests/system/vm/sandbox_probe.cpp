// SPDX-License-Identifier: BSD-3-Clause
// Run as the service in its sandbox: tries what a service that was taken over would try, and what
// this one needs. A line each; exit status 1 where anything was allowed that must not be, or
// refused that is needed.
#include <dirent.h>
#include <fcntl.h>
#include <linux/bpf.h>
#include <linux/can.h>
#include <linux/perf_event.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/klog.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/personality.h>
#include <sys/ptrace.h>
#include <sys/reboot.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/swap.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/timex.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

namespace {

struct Attempt {
  std::string what;
  std::function<long()> tries;  ///< negative, and errno: refused
};

long opens(const std::string& path, int flags) {
  const int fd = open(path.c_str(), flags | O_CLOEXEC | O_NOCTTY, 0600);
  if (fd >= 0) close(fd);
  return fd;
}

long writes(const std::string& path, const std::string& text) {
  const int fd = open(path.c_str(), O_WRONLY | O_CLOEXEC);
  if (fd < 0) return fd;
  const long written = write(fd, text.data(), text.size());
  const int error = errno;
  close(fd);
  errno = error;
  return written;
}

long lists(const char* path) {
  DIR* folder = opendir(path);
  if (!folder) return -1;
  long entries = 0;
  while (const dirent* entry = readdir(folder)) entries += entry->d_name[0] != '.';
  closedir(folder);
  errno = ENOENT;  // an empty one is as good as none
  return entries ? entries : -1;
}

long has_socket(int family, int type, int protocol = 0) {
  const int fd = socket(family, type | SOCK_CLOEXEC, protocol);
  if (fd >= 0) close(fd);
  return fd;
}

sockaddr_in address(std::uint32_t ip, std::uint16_t port) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_addr.s_addr = htonl(ip);
  out.sin_port = htons(port);
  return out;
}

long sends_to(std::uint32_t ip) {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return fd;
  const sockaddr_in to = address(ip, 9);
  const long sent = sendto(fd, "x", 1, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  const int error = errno;
  close(fd);
  errno = error;
  return sent;
}

long binds(std::uint16_t port) {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return fd;
  const sockaddr_in at = address(INADDR_ANY, port);
  const int bound = bind(fd, reinterpret_cast<const sockaddr*>(&at), sizeof at);
  const int error = errno;
  close(fd);
  errno = error;
  return bound;
}

long maps_writable_code() {
  void* page =
      mmap(nullptr, 4096, PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  return page == MAP_FAILED ? -1 : 0;
}

long makes_setuid_file(const std::string& folder) {
  const std::string path = folder + "/probe";
  const int fd = open(path.c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
  if (fd < 0) return 0;  // its own folder must be writable: a failure of the probe
  const int made = fchmod(fd, 04700);
  const int error = errno;
  close(fd);
  unlink(path.c_str());
  errno = error;
  return made;
}

long runs_in_real_time() {
  sched_param first{};
  first.sched_priority = 1;
  return sched_setscheduler(0, SCHED_RR, &first);
}

long sets_clock() {
  const timespec time{1'000'000'000, 0};
  return clock_settime(CLOCK_REALTIME, &time);
}

long steers_clock() {
  timex change{};
  change.modes = ADJ_TICK;
  change.tick = 10000;
  return adjtimex(&change);
}

long loads_bpf() {
  bpf_attr attributes{};
  return syscall(SYS_bpf, BPF_PROG_LOAD, &attributes, sizeof attributes);
}

long counts_kernel_events() {
  perf_event_attr attributes{};
  attributes.type = PERF_TYPE_SOFTWARE;
  attributes.size = sizeof attributes;
  return syscall(SYS_perf_event_open, &attributes, -1, 0, -1, 0);
}

std::vector<Attempt> forbidden(const std::string& root_disk) {
  static char log[16];
  return {
      {"write into /usr/bin", [] { return opens("/usr/bin/probe", O_CREAT | O_WRONLY); }},
      {"write into /etc", [] { return opens("/etc/probe", O_CREAT | O_WRONLY); }},
      {"write its own rig file", [] { return opens("/etc/throwcal/rig.toml", O_WRONLY); }},
      {"write into /var/log", [] { return opens("/var/log/probe", O_CREAT | O_WRONLY); }},
      {"read /root", [] { return lists("/root"); }},
      {"read /home", [] { return lists("/home"); }},
      {"read /etc/shadow", [] { return opens("/etc/shadow", O_RDONLY); }},
      {"see process 1", [] { return opens("/proc/1/status", O_RDONLY); }},
      {"read /proc/kallsyms", [] { return opens("/proc/kallsyms", O_RDONLY); }},
      {"write /proc/sys", [] { return writes("/proc/sys/kernel/domainname", "probe"); }},
      {"write /sys/fs/cgroup", [] { return writes("/sys/fs/cgroup/cgroup.procs", "0"); }},
      {"write /sys/power/state", [] { return writes("/sys/power/state", "freeze"); }},
      {"open /dev/mem", [] { return opens("/dev/mem", O_RDONLY); }},
      {"open /dev/kmsg", [] { return opens("/dev/kmsg", O_RDONLY); }},
      {"open /dev/tty1", [] { return opens("/dev/tty1", O_RDWR); }},
      {"open /dev/uinput", [] { return opens("/dev/uinput", O_RDWR); }},
      {"open /dev/rtc0 for writing", [] { return opens("/dev/rtc0", O_RDWR); }},
      {"open the disk " + root_disk, [=] { return opens(root_disk, O_RDONLY); }},
      {"mount", [] { return mount("none", "/tmp", "tmpfs", 0, nullptr); }},
      {"chroot", [] { return chroot("/tmp"); }},
      {"make a user namespace", [] { return unshare(CLONE_NEWUSER); }},
      {"make a mount namespace", [] { return unshare(CLONE_NEWNS); }},
      {"make a network namespace", [] { return unshare(CLONE_NEWNET); }},
      {"become root", [] { return setuid(0); }},
      {"become root's group", [] { return setgid(0); }},
      {"make a set-user-id file", [] { return makes_setuid_file("/var/lib/throwcal"); }},
      {"trace its parent", [] { return ptrace(PTRACE_ATTACH, getppid(), nullptr, nullptr); }},
      {"set the clock", sets_clock},
      {"steer the clock", steers_clock},
      {"set the host's name", [] { return sethostname("probe", 5); }},
      {"load a kernel module", [] { return syscall(SYS_finit_module, 0, "", 0); }},
      {"restart the machine", [] { return reboot(RB_DISABLE_CAD); }},
      {"swap", [] { return swapoff("/nothing"); }},
      {"read the kernel's log", [] { return klogctl(3, log, sizeof log); }},
      {"load a BPF program", loads_bpf},
      {"count the kernel's events", counts_kernel_events},
      {"run in real time", runs_in_real_time},
      {"go before others", [] { return setpriority(PRIO_PROCESS, 0, -5); }},
      {"map code that can be written", maps_writable_code},
      {"another personality", [] { return personality(ADDR_NO_RANDOMIZE); }},
      {"a raw packet socket", [] { return has_socket(AF_PACKET, SOCK_RAW); }},
      {"a raw IP socket", [] { return has_socket(AF_INET, SOCK_RAW, IPPROTO_ICMP); }},
      {"a socket of the kernel's cipher", [] { return has_socket(AF_ALG, SOCK_SEQPACKET); }},
      {"a socket to the hypervisor", [] { return has_socket(AF_VSOCK, SOCK_STREAM); }},
      {"send into the internet", [] { return sends_to(0x08080808); }},
      {"listen at port 80", [] { return binds(80); }},
  };
}

std::vector<Attempt> needed() {
  return {
      {"write into its own folder",
       [] {
         const long made = opens("/var/lib/throwcal/probe", O_CREAT | O_WRONLY);
         unlink("/var/lib/throwcal/probe");
         return made;
       }},
      {"read its rig file", [] { return opens("/etc/throwcal/rig.toml", O_RDONLY); }},
      {"listen at port 7710", [] { return binds(17710); }},
      {"talk to itself", [] { return sends_to(INADDR_LOOPBACK); }},
      {"a CAN socket", [] { return has_socket(AF_CAN, SOCK_RAW, CAN_RAW); }},
      {"watch for devices", [] { return has_socket(AF_NETLINK, SOCK_RAW, 15); }},
  };
}

}  // namespace

// sandbox_probe DISK [DEVICE...]: the devices must be usable.
int main(int argc, char** argv) {
  int wrong = 0;
  const auto tell = [&](const Attempt& attempt, bool may) {
    errno = 0;
    const bool done = attempt.tries() >= 0;
    const int error = errno;
    wrong += done != may;
    std::printf("%s%s: %s\n", done == may ? "" : "WRONG: ", attempt.what.c_str(),
                done ? "done" : std::strerror(error));
  };
  for (const Attempt& attempt : forbidden(argc > 1 ? argv[1] : "/dev/vda")) tell(attempt, false);
  for (const Attempt& attempt : needed()) tell(attempt, true);
  for (int i = 2; i < argc; ++i)
    tell({std::string("use ") + argv[i], [&] { return opens(argv[i], O_RDWR); }}, true);
  std::printf("probe: %d wrong\n", wrong);
  return wrong ? 1 : 0;
}
