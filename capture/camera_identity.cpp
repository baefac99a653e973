// SPDX-License-Identifier: BSD-3-Clause
#include "capture/camera_identity.h"

#include "capture/quotation.h"
#include "capture/usb_device.h"

namespace throwcal {

CameraIdentity usb_identity(const std::filesystem::path& device,
                            const std::filesystem::path& sysfs) {
  const auto usb = usb_device_of(device, sysfs);
  if (!usb) return {};
  return {.port = {}, .model = usb->text("product"), .serial = usb->text("serial"), .mode = {}};
}

std::string description(const CameraIdentity& identity) {
  const std::string model = identity.model.empty() ? "a camera" : in_quotes(identity.model);
  return model + (identity.serial.empty() ? ", no serial number"
                                          : ", serial " + printable(identity.serial));
}

}  // namespace throwcal
