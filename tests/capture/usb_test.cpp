// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "capture/camera_identity.h"
#include "capture/usb_device.h"
#include "capture/usb_load.h"
#include "capture/v4l2_list.h"

namespace throwcal {
namespace {

namespace fs = std::filesystem;

/// A sysfs with a camera, as Linux 6.1 has it: the class link leads to the interface, whose parent
/// is the device.
class Usb : public ::testing::Test {
 protected:
  Usb() : root_(fs::temp_directory_path() / ("usb_test." + std::to_string(getpid()))) {
    fs::create_directories(root_ / "dev");
  }
  ~Usb() override { fs::remove_all(root_); }

  static void write(const fs::path& file, const std::string& text) {
    fs::create_directories(file.parent_path());
    std::ofstream(file) << text << '\n';
  }
  /// The device's node.
  fs::path plug(const std::string& video, const std::string& port, const std::string& hub,
                const std::string& serial) const {
    const fs::path bus = root_ / "sys/devices/pci0/usb1";
    const fs::path device = bus / (hub + port);
    write(bus / "idVendor", "1d6b");
    write(device / "idVendor", "1209");
    write(device / "busnum", "1");
    write(device / "devpath", port.substr(2));
    write(device / "speed", "480");
    write(device / "product", "Eye 300");
    if (!serial.empty()) write(device / "serial", serial);
    fs::create_directories(device / (port + ":1.0"));
    fs::create_directories(root_ / "sys/class/video4linux" / video);
    fs::create_symlink(device / (port + ":1.0"),
                       root_ / "sys/class/video4linux" / video / "device");
    write(root_ / "dev" / video, "");
    return root_ / "dev" / video;
  }
  fs::path sysfs() const { return root_ / "sys"; }
  void host(const std::string& product) const {
    write(root_ / "sys/devices/pci0/usb1/product", product);
  }

  fs::path root_;
};

TEST_F(Usb, ACameraIsKnownByModelAndSerialThroughALinkToo) {
  const fs::path node = plug("video0", "1-3", "", "SN0042");
  fs::create_symlink(node, root_ / "by-path");
  for (const fs::path& path : {node, root_ / "by-path"}) {
    const CameraIdentity identity = usb_identity(path, sysfs());
    EXPECT_EQ(identity.model, "Eye 300");
    EXPECT_EQ(identity.serial, "SN0042");
  }
  EXPECT_EQ(description(usb_identity(node, sysfs())), "\"Eye 300\", serial SN0042");
}

TEST_F(Usb, ACameraMayHaveNoSerialAndADeviceNoUsb) {
  EXPECT_EQ(description(usb_identity(plug("video0", "1-3", "", ""), sysfs())),
            "\"Eye 300\", no serial number");
  fs::create_directories(sysfs() / "class/video4linux/video1");
  fs::create_directories(sysfs() / "devices/platform/vivid.0");
  fs::create_symlink(sysfs() / "devices/platform/vivid.0",
                     sysfs() / "class/video4linux/video1/device");
  write(root_ / "dev/video1", "");
  EXPECT_EQ(usb_identity(root_ / "dev/video1", sysfs()), CameraIdentity{});
  EXPECT_EQ(usb_identity(root_ / "dev/nothing", sysfs()), CameraIdentity{});
}

TEST_F(Usb, OfTwoLinksToOnePortTheOneThatEveryDebianMakesIsNamed) {
  const fs::path first = fs::canonical(plug("video0", "1-1", "", "")),
                 second = fs::canonical(plug("video1", "1-2", "", "")), links = root_ / "by-path";
  fs::create_directories(links);
  const auto named = [&](const fs::path& device) {
    return fs::path(by_path(device, links)).filename().string();
  };
  EXPECT_EQ(named(first), "");
  fs::create_symlink("../dev/video0", links / "pci-usbv2-0:1:1.0-video-index0");
  fs::create_symlink("../dev/gone", links / "pci-0:9");
  EXPECT_EQ(named(first), "pci-usbv2-0:1:1.0-video-index0");
  fs::create_symlink("../dev/video0", links / "pci-usb-0:1:1.0-video-index0");
  fs::create_symlink("../dev/video1", links / "pci-usb-0:2:1.0-video-index0");
  EXPECT_EQ(named(first), "pci-usb-0:1:1.0-video-index0");
  EXPECT_EQ(named(second), "pci-usb-0:2:1.0-video-index0");
  EXPECT_EQ(by_path(first, root_ / "nowhere"), "");
}

TEST_F(Usb, BandwidthIsSharedByABusOrBelowAnXhciByAPort) {
  const auto near = usb_device_of(plug("video0", "1-3", "", ""), sysfs());
  const auto behind_a_hub = usb_device_of(plug("video1", "1-2.4", "1-2/", ""), sysfs());
  ASSERT_TRUE(near && behind_a_hub);
  EXPECT_EQ(near->speed_mbps(), 480.0);
  host("EHCI Host Controller");
  EXPECT_EQ(near->segment(), "USB bus 1");
  EXPECT_EQ(behind_a_hub->segment(), "USB bus 1");
  host("xHCI Host Controller");
  EXPECT_EQ(near->segment(), "USB bus 1, port 3");
  EXPECT_EQ(behind_a_hub->segment(), "USB bus 1, port 2");
}

TEST(UsbLoad, TellsTheSumOfABusAndWhatHelps) {
  const UsbStream north{"north", "USB bus 1", 480, 36.9}, east{"east", "USB bus 1", 480, 18.4},
      compressed{"west", "USB bus 1", 480, 0}, elsewhere{"south", "USB bus 2", 480, 36.9};
  EXPECT_TRUE(usb_overloads({north, elsewhere}).empty());
  EXPECT_TRUE(usb_overloads({north, compressed}).empty());
  const auto told = usb_overloads({north, elsewhere, east, compressed});
  ASSERT_EQ(told.size(), 1u);
  EXPECT_EQ(told[0],
            "USB bus 1 carries 48.0 MB/s of pictures, but 55.3 are wanted (north 36.9, east "
            "18.4, west what its compressed pictures take): " +
                std::string(usb_remedy));
}

TEST(UsbLoad, AFasterLinkCarriesMore) {
  EXPECT_DOUBLE_EQ(usb_capacity_mb_per_s(480), 48);
  EXPECT_DOUBLE_EQ(usb_capacity_mb_per_s(5000), 400);
}

}  // namespace
}  // namespace throwcal
