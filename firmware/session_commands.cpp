// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <cstdio>
#include <iostream>
#include <map>
#include <opencv2/imgcodecs.hpp>

#include "firmware/base64.h"
#include "firmware/box_options.h"
#include "firmware/commands.h"
#include "firmware/export.h"
#include "firmware/input_error.h"
#include "firmware/progress_bar.h"
#include "firmware/session_replay.h"
#include "firmware/sightings_file.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

namespace fs = std::filesystem;

/// A session is named by its number on the box, or it is a file here.
std::optional<std::int64_t> number_of(const std::string& session) {
  if (session.empty() || session.size() > 9 ||
      session.find_first_not_of("0123456789") != session.npos)
    return {};
  return std::stoll(session);
}

std::string words(const Json& summary) {
  const auto text = [&](const char* key) {
    return summary.contains(key) && summary[key].is_string() ? summary[key].get<std::string>()
                                                             : std::string("-");
  };
  char line[256];
  std::snprintf(line, sizeof line, "%7lld  %-20s  %-11s %6d  %-17s %8.1f MB  %s\n",
                static_cast<long long>(summary.at("session").get<std::int64_t>()),
                text("started_utc").c_str(), text("state").c_str(), summary.value("throws", 0),
                text("verdict").c_str(), 1e-6 * summary.at("bytes").get<double>(),
                summary.contains("problem") ? text("problem").c_str() : "");
  return line;
}

constexpr const char* header =
    "session  started               state       throws  verdict               size\n";

void list_sessions(const BoxOptions& options) {
  const Json list = options.connect().call("session.list");
  std::string out = options.json ? list.dump(2) + "\n" : header;
  if (!options.json)
    for (const Json& each : list) out += words(each);
  std::fputs(out.c_str(), stdout);
}

/// What a file holds, in the words of the box's session.get.
Json summary_of(const fs::path& file) {
  const SessionFile session(file, SessionFile::For::reading);
  const SessionFacts facts = session.facts();
  Json out{{"session", facts.id},
           {"file", file.filename().string()},
           {"bytes", fs::file_size(file)},
           {"state", facts.state},
           {"started_utc", facts.started_utc},
           {"stopped_utc", facts.stopped_utc},
           {"unit", facts.unit},
           {"software", facts.software},
           {"cameras", facts.cameras},
           {"flights", session.flights().size()},
           {"evidence_bytes", session.evidence_bytes()},
           {"devices", facts.devices},
           {"calibrations", Json::array()}};
  for (const StoredCalibration& each : session.calibrations()) {
    out["calibrations"].push_back({{"number", each.number},
                                   {"created_utc", each.created_utc},
                                   {"verdict", each.verdict},
                                   {"throws", each.throws},
                                   {"flights", each.flights}});
    out["throws"] = each.throws;
    out["verdict"] = each.verdict;
  }
  return out;
}

void show(const BoxOptions& options, const std::string& session) {
  const auto number = number_of(session);
  const Json out =
      number ? options.connect().call("session.get", {{"session", *number}}) : summary_of(session);
  std::fputs(options.json ? (out.dump(2) + "\n").c_str() : (header + words(out)).c_str(), stdout);
  if (options.json) return;
  for (const Json& each : out.at("calibrations"))
    std::printf("  calibration %lld of %s: %s, %d throws, %lld flights\n",
                static_cast<long long>(each.value("id", each.value("number", std::int64_t{0}))),
                each.at("created_utc").get<std::string>().c_str(),
                each.at("verdict").get<std::string>().c_str(), each.at("throws").get<int>(),
                static_cast<long long>(each.at("flights").get<std::int64_t>()));
}

/// The box's file, whole.
std::string download(const BoxOptions& options, std::int64_t session) {
  BoxClient box = options.connect();
  ProgressBar bar("fetching session " + std::to_string(session));
  std::string out;
  for (std::int64_t size = 1; static_cast<std::int64_t>(out.size()) < size;) {
    const Json part = box.call("session.read", {{"session", session}, {"offset", out.size()}});
    size = part.at("bytes").get<std::int64_t>();
    const auto bytes = from_base64(part.at("data").get<std::string>());
    if (!bytes || (bytes->empty() && size > static_cast<std::int64_t>(out.size())))
      throw BoxError("the box sent a part of session " + std::to_string(session) + " that is none");
    out += *bytes;
    bar.show(static_cast<double>(out.size()) /
             static_cast<double>(std::max<std::int64_t>(1, size)));
  }
  return out;
}

std::vector<SightingRow> rows_of(const SessionReplay& replay) {
  std::map<std::uint64_t, ThrowId> throw_of;
  for (const Throw& each : replay.throws())
    for (const Track& track : each.tracks)
      for (const BallSighting& s : track.sightings) throw_of[s.id] = each.id;
  std::vector<SightingRow> out;
  for (const Track& flight : replay.flights())
    for (const BallSighting& s : flight.sightings)
      out.push_back({s, throw_of.contains(s.id) ? throw_of[s.id] : ThrowId{}});
  return out;
}

void write_pictures(const SessionFile& session, const SessionFacts& facts, const fs::path& folder) {
  fs::create_directories(folder);
  session.each_evidence([&](const Evidence& e) {
    if (e.camera >= facts.cameras.size())
      throw InputError("a picture is of camera " + std::to_string(e.camera + 1) +
                       ", which the session has not");
    char place[96];
    std::snprintf(place, sizeof place, "%lld_x%d_y%d_step%d",
                  static_cast<long long>(e.time.time_since_epoch().count()), e.x_px, e.y_px,
                  e.step_px);
    const std::string kind =
        e.flight > 0 ? "_flight" + std::to_string(e.flight) + "_" : "_background_";
    const fs::path file = folder / (facts.cameras[e.camera] + kind + place + ".png");
    const cv::Mat pixels(e.height, e.width, CV_8UC1, const_cast<char*>(e.pixels.data()));
    if (!cv::imwrite(file.string(), pixels)) throw InputError(file.string() + ": can't be written");
  });
}

/// Everything in files that other programs read.
void unpack(const fs::path& file, const fs::path& folder) {
  const SessionReplay replay(file);
  fs::create_directories(folder);
  write_text_file(folder / "session.json", summary_of(file).dump(2) + "\n");
  write_text_file(folder / "rig.toml", replay.facts().rig_toml);
  write_text_file(folder / "sightings.csv",
                  to_sightings_csv(rows_of(replay), replay.config().rig, true));
  if (replay.original())
    write_text_file(folder / "calibration.json",
                    parse_json(replay.original()->document, file.string()).dump(2) + "\n");
  const SessionFile session(file, SessionFile::For::reading);
  write_pictures(session, replay.facts(), folder / "pictures");
  std::printf("Written: %s\n", folder.c_str());
}

/// In the folder that a box's session is unpacked into.
constexpr const char* fetched_name = "session.throwcal";

struct ExportOptions {
  std::string session, output;
  bool unpacked = false;
};

void export_session(const BoxOptions& box, const ExportOptions& options) {
  const auto number = number_of(options.session);
  if (!number && !options.unpacked)
    throw InputError("export " + options.session + ": it is a file here; expected --unpack");
  if (!number) return unpack(options.session, options.output);
  const std::string session = download(box, *number);
  if (options.unpacked) fs::create_directories(options.output);
  const fs::path file =
      options.unpacked ? fs::path(options.output) / fetched_name : fs::path(options.output);
  write_text_file(file, session);
  if (options.unpacked) return unpack(file, options.output);
  std::printf("Written: %s\n", file.c_str());
}

void delete_session(const BoxOptions& options, std::int64_t session, bool is_sure) {
  if (!is_sure && isatty(STDIN_FILENO) == 1) {
    std::fprintf(stderr, "Delete session %lld with its calibration? [y/N] ",
                 static_cast<long long>(session));
    std::string answer;
    std::getline(std::cin, answer);
    if (answer != "y" && answer != "Y") return;
  }
  BoxClient box = options.connect();
  options.authenticate(box);
  box.call("session.delete", {{"session", session}});
  std::printf("session %lld is deleted\n", static_cast<long long>(session));
}

}  // namespace

void add_session_commands(CLI::App& app, int& status, const std::shared_ptr<BoxOptions>& box) {
  auto options = std::make_shared<ExportOptions>();
  auto* sessions = app.add_subcommand("sessions", "List what a box has kept");
  sessions->callback([box, &status] { list_sessions(*box), status = exit_accepted; });

  auto* shown = app.add_subcommand("show", "Tell what is in a session");
  shown->add_option("session", options->session, "Its number on the box, or a file here")
      ->required();
  shown->callback([=, &status] { show(*box, options->session), status = exit_accepted; });

  auto* exported = app.add_subcommand("export", "Fetch a session, or unpack it");
  exported->add_option("session", options->session, "Its number on the box, or a file here")
      ->required();
  exported->add_option("--output", options->output, "The file, or with --unpack the folder")
      ->required();
  exported->add_flag("--unpack", options->unpacked,
                     "As rig.toml, sightings.csv, calibration.json and pictures; a session of the "
                     "box stays there as session.throwcal, too");
  exported->footer(
      "Example:\n  throwcal export 7 --host box.local --output 000007.throwcal\n"
      "  throwcal calibrate --session 000007.throwcal --output calibration.json\n"
      "  throwcal export 000007.throwcal --unpack --output session7");
  exported->callback([=, &status] { export_session(*box, *options), status = exit_accepted; });

  auto* deleted = app.add_subcommand("delete", "Delete a session from the box");
  auto number = std::make_shared<std::int64_t>(0);
  auto is_sure = std::make_shared<bool>(false);
  deleted->add_option("session", *number, "Its number")->required()->check(CLI::PositiveNumber);
  deleted->add_flag("--yes", *is_sure, "Don't ask");
  deleted->callback([=, &status] {
    delete_session(*box, *number, *is_sure);
    status = exit_accepted;
  });
  for (CLI::App* command : {sessions, shown, exported, deleted}) box->add_to(*command);
  box->add_token_to(*deleted);
}

}  // namespace throwcal
