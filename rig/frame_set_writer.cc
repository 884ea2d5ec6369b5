#include "rig/frame_set_writer.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "rig/png_encoder.h"
#include "sfm/core/checksum.h"
#include "sfm/core/file_io.h"

namespace rotunda::rig {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr auto kRetryInterval = std::chrono::milliseconds(1000);
constexpr auto kWaitPollInterval = std::chrono::milliseconds(50);
// Frames that arrive cannot wait, files can.
constexpr int kNiceness = 10;

void LowerPriorityOnce() {
  thread_local const bool lowered =
      ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kNiceness) == 0;
  static_cast<void>(lowered);
}

int ChannelsOf(const CameraFrame& frame) {
  return static_cast<int>(BytesPerPixel(frame.pixel_format));
}

/// Whether writing to `out` may work when it is tried again although nobody does anything else
/// than to make room.
bool MayPass(const Error& error, const fs::path& out) {
  if (error.code != ErrorCode::kIo) return false;
  const Status place = CheckOutputPlace(out, 0);
  return place.ok() || place.error().code == ErrorCode::kIo;
}

PixelsView ViewOf(const CameraFrame& frame) {
  const int channels = ChannelsOf(frame);
  const size_t size = static_cast<size_t>(frame.width_px) * frame.height_px * channels;
  return {{frame.memory.data(), size}, frame.width_px, frame.height_px, channels};
}

Frame DescribeFrame(const CameraShot& shot) {
  Frame frame;
  frame.camera = shot.camera;
  frame.serial = shot.serial;
  frame.width_px = shot.settings.width_px;
  frame.height_px = shot.settings.height_px;
  frame.pixel_format = shot.settings.pixel_format;
  frame.exposure_us = shot.settings.exposure_us;
  frame.gain_db = shot.settings.gain_db;
  frame.status = VerdictName(shot.verdict);
  if (shot.frame) {
    frame.file = "frames/" + shot.camera + ".png";
    frame.width_px = shot.frame->width_px;
    frame.height_px = shot.frame->height_px;
    frame.pixel_format = shot.frame->pixel_format;
    frame.frame_id = shot.frame->frame_id;
    frame.timestamp_ns = shot.frame->timestamp_ns;
  }
  return frame;
}

FrameSet DescribeSet(const FrameSetOrder& order, const Shot& shot) {
  FrameSet set;
  set.id = order.id;
  set.captured_at = order.captured_at;
  set.subject = order.subject;
  set.trigger["source"] = order.trigger_source;
  set.trigger["pulses"] = static_cast<uint64_t>(shot.pulses);
  set.trigger["complete"] = shot.complete();
  set.trigger["ok"] = static_cast<uint64_t>(shot.OkCount());
  set.trigger["of"] = static_cast<uint64_t>(shot.cameras.size());
  if (shot.skew.known()) {
    set.trigger["median_skew_us"] = shot.skew.median_us;
    set.trigger["max_skew_us"] = shot.skew.max_us;
    set.trigger["max_skew_camera"] = shot.skew.worst;
  }
  set.trigger["resent_packets"] = shot.ResentPackets();
  for (const CameraShot& camera : shot.cameras) set.frames.push_back(DescribeFrame(camera));
  return set;
}

/// shot.json: what frameset.json has no place for, camera by camera.
std::string ShotText(const Shot& shot, const std::map<std::string, PictureFigures>& figures) {
  Json cameras = Json::array();
  for (const CameraShot& each : shot.cameras) {
    Json camera = {{"camera", each.camera}, {"verdict", VerdictName(each.verdict)}};
    if (!each.reason.empty()) camera["reason"] = each.reason;
    if (each.skew_us) {
      camera["skew_us"] = *each.skew_us;
      camera["clock_uncertainty_us"] = each.clock_uncertainty_us;
    }
    if (each.arrival_ms) camera["arrival_ms"] = *each.arrival_ms;
    camera["resent_packets"] = each.resent_packets;
    if (const auto found = figures.find(each.camera); found != figures.end()) {
      camera["mean_level"] = found->second.mean_level;
      camera["clipped_part"] = found->second.clipped_part;
      camera["sharpness"] = found->second.sharpness;
    }
    cameras.push_back(std::move(camera));
  }
  Json root = {{"format", "rotunda-shot/1"}, {"pulses", shot.pulses}};
  if (shot.interrupted) root["interrupted"] = true;
  if (!shot.first_try.empty()) root["first_try"] = shot.first_try;
  root["cameras"] = std::move(cameras);
  return root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace

PictureFigures MeasurePicture(const CameraFrame& frame) {
  const bool bayer = frame.pixel_format.starts_with("Bayer");
  const size_t channels = static_cast<size_t>(ChannelsOf(frame));
  const size_t grid = bayer ? 2 : 1;
  const bool green_second = frame.pixel_format == "BayerRG8" || frame.pixel_format == "BayerBG8";
  const size_t first = bayer ? (green_second ? 1 : 0) : (channels == 3 ? 1 : 0);
  const size_t across = grid * channels;
  const size_t down = grid * static_cast<size_t>(frame.width_px) * channels;
  const size_t columns = static_cast<size_t>(frame.width_px) / grid;
  const size_t rows = static_cast<size_t>(frame.height_px) / grid;
  PictureFigures figures;
  if (columns < 3 || rows < 3) return figures;
  uint64_t sum = 0, clipped = 0, laplacian = 0;
  for (size_t y = 1; y + 1 < rows; ++y) {
    const uint8_t* row = frame.memory.data() + first + y * down;
    for (size_t x = 1; x + 1 < columns; ++x) {
      const uint8_t* at = row + x * across;
      const int bend = 4 * at[0] - *(at - across) - at[across] - *(at - down) - at[down];
      sum += at[0];
      clipped += at[0] == 255;
      laplacian += static_cast<uint64_t>(bend * bend);
    }
  }
  const auto count = static_cast<double>((columns - 2) * (rows - 2));
  figures.mean_level = static_cast<double>(sum) / count;
  figures.clipped_part = static_cast<double>(clipped) / count;
  figures.sharpness = sum == 0 ? 0 : static_cast<double>(laplacian) / static_cast<double>(sum);
  return figures;
}

struct FrameSetWriter::Job {
  Ticket ticket = 0;
  FrameSetOrder order;
  Shot shot;
  std::optional<Trouble> trouble;
};

FrameSetWriter::FrameSetWriter(int threads) : threads_(threads), thread_([this] { Run(); }) {}

FrameSetWriter::~FrameSetWriter() {
  {
    const std::lock_guard lock(mutex_);
    quit_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

FrameSetWriter::Ticket FrameSetWriter::Submit(FrameSetOrder order, Shot shot) {
  Ticket ticket = 0;
  {
    const std::lock_guard lock(mutex_);
    ticket = ++last_ticket_;
    jobs_.push_back({ticket, std::move(order), std::move(shot), std::nullopt});
  }
  changed_.notify_all();
  return ticket;
}

Result<WrittenSet> FrameSetWriter::Wait(Ticket ticket, std::stop_token stop) {
  std::unique_lock lock(mutex_);
  while (true) {
    if (const auto found = done_.find(ticket); found != done_.end()) {
      Result<WrittenSet> result = std::move(found->second);
      done_.erase(found);
      return result;
    }
    const auto aside = std::find_if(jobs_.begin(), jobs_.end(), [&](const Job& job) {
      return job.ticket == ticket && job.trouble && !job.trouble->tried_again;
    });
    if (aside != jobs_.end()) return aside->trouble->error;
    if (stop.stop_requested()) {
      return Error{ErrorCode::kCancelled, "stopped while the frame set was being written", ""};
    }
    changed_.wait_for(lock, kWaitPollInterval);
  }
}

Status FrameSetWriter::Redirect(Ticket ticket, fs::path out) {
  {
    const std::lock_guard lock(mutex_);
    const auto aside = std::find_if(jobs_.begin(), jobs_.end(), [&](const Job& job) {
      return job.ticket == ticket && job.trouble && !job.trouble->tried_again;
    });
    if (aside == jobs_.end()) {
      return Error{ErrorCode::kNotFound, "no such set is set aside", out.string()};
    }
    aside->order.out = std::move(out);
    aside->trouble.reset();
  }
  changed_.notify_all();
  return {};
}

void FrameSetWriter::Abandon(Ticket ticket) {
  {
    const std::lock_guard lock(mutex_);
    const auto found = std::find_if(jobs_.begin(), jobs_.end(),
                                    [&](const Job& job) { return job.ticket == ticket; });
    if (found == jobs_.end()) return;
    if (ticket == writing_) {
      abandon_writing_ = true;
    } else {
      done_.emplace(ticket, Error{ErrorCode::kFailed, "was given up", found->order.out.string()});
      jobs_.erase(found);
    }
  }
  changed_.notify_all();
}

size_t FrameSetWriter::pending() const {
  const std::lock_guard lock(mutex_);
  return jobs_.size();
}

std::optional<FrameSetWriter::Trouble> FrameSetWriter::trouble() const {
  const std::lock_guard lock(mutex_);
  const auto found = std::find_if(jobs_.begin(), jobs_.end(),
                                  [](const Job& job) { return job.trouble.has_value(); });
  return found == jobs_.end() ? std::nullopt : found->trouble;
}

std::list<FrameSetWriter::Job>::iterator FrameSetWriter::NextJob() {
  return std::find_if(jobs_.begin(), jobs_.end(),
                      [](const Job& job) { return !job.trouble || job.trouble->tried_again; });
}

void FrameSetWriter::Run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return quit_ || NextJob() != jobs_.end(); });
    const auto job = NextJob();
    if (job == jobs_.end()) return;
    writing_ = job->ticket;
    lock.unlock();
    Result<WrittenSet> written = Write(*job);
    const bool may_pass = !written && MayPass(written.error(), job->order.out);
    lock.lock();
    if (!written) {
      job->trouble = Trouble{job->order.out, written.error(), may_pass};
      ++signs_of_life_;
      changed_.notify_all();
      if (may_pass) {
        changed_.wait_for(lock, kRetryInterval, [&] { return quit_ || abandon_writing_; });
      }
    }
    writing_ = 0;
    const bool abandoned = std::exchange(abandon_writing_, false);
    if (!written && !abandoned && !quit_) continue;
    done_.emplace(job->ticket, std::move(written));
    jobs_.erase(job);
    changed_.notify_all();
  }
}

Result<WrittenSet> FrameSetWriter::Write(const Job& job) {
  ROTUNDA_ASSIGN_OR_RETURN(OutputFolder folder, OutputFolder::Begin(job.order.out));
  Result<WrittenSet> written = Fill(job, folder.path());
  if (!written) return folder.InPlace(written.error());
  ROTUNDA_RETURN_IF_ERROR(folder.Commit());
  return written;
}

Result<WrittenSet> FrameSetWriter::Fill(const Job& job, const fs::path& folder) {
  std::error_code failed;
  fs::create_directory(folder / "frames", failed);
  if (failed) return Error{ErrorCode::kIo, failed.message(), (folder / "frames").string()};
  FrameSet set = DescribeSet(job.order, job.shot);
  const size_t count = job.shot.cameras.size();
  std::vector<PictureFigures> figures(count);
  std::vector<size_t> sizes(count);
  std::vector<std::optional<Error>> errors(count);
  std::stop_source stop;
  threads_.ParallelFor(
      count,
      [&](size_t i) {
        LowerPriorityOnce();
        const std::optional<CameraFrame>& frame = job.shot.cameras[i].frame;
        if (!frame) return;
        const Result<std::string> png = EncodePng(ViewOf(*frame));
        const Status status = png ? WriteNewFile(folder / set.frames[i].file, *png)
                                  : Status(png.error().In(set.frames[i].camera));
        if (!status) {
          errors[i] = status.error();
          stop.request_stop();
          return;
        }
        ++signs_of_life_;
        sizes[i] = png->size();
        set.frames[i].xxh3 = Xxh3Text(*png);
        figures[i] = MeasurePicture(*frame);
      },
      stop.get_token());
  WrittenSet written{job.order.out, {}, 0};
  for (size_t i = 0; i < count; ++i) {
    if (errors[i]) return *errors[i];
    written.bytes += sizes[i];
    if (job.shot.cameras[i].frame) written.figures[set.frames[i].camera] = figures[i];
  }
  ROTUNDA_RETURN_IF_ERROR(WriteNewFile(folder / "shot.json", ShotText(job.shot, written.figures)));
  if (job.order.calibration) {
    ROTUNDA_RETURN_IF_ERROR(WriteNewFile(folder / "calibration.json", *job.order.calibration));
  }
  ROTUNDA_RETURN_IF_ERROR(WriteNewFile(folder / "frameset.json", FrameSetToJson(set)));
  return written;
}

}  // namespace rotunda::rig
