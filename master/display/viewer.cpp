#include "master/display/viewer.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/size.h"
#include "common/engine/integrators/path/light_range.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using nlohmann::ordered_json;

/// Messages of a browser: a few for each frame of its screen, and a burst when a page wakes up.
constexpr double kMessagesPerS = 300, kMostMessages = 600;
/// Messages that cannot be read: a page of another version sends a few; a flood disconnects the viewer.
constexpr double kMistakesPerS = 1, kMostMistakes = 20;
/// Limits for texts that wait for a browser, in bytes, beside its welcome. Beyond the first, only required
/// texts are sent; beyond the second, the viewer is disconnected. 64 viewers take 16 MiB at most.
constexpr uint64_t kBehindBytes = 32u << 10, kFarBehindBytes = 256u << 10;
/// Seconds within which a browser must take a frame, and least bytes a second of a slow line.
constexpr double kStallS = 30, kSlowLine = 16 << 10;

std::string ErrorText(const std::string& sentence) {
  return ordered_json{{"type", "error"}, {"message", sentence}}.dump(-1, ' ', false,
                                                                     ordered_json::error_handler_t::replace);
}

std::string RefusalText(const std::string& sentence) {
  return ordered_json{{"type", "refused"}, {"message", sentence}}.dump(
      -1, ' ', false, ordered_json::error_handler_t::replace);
}

std::string IdText(uint64_t id) { return fmt::format("{:016x}", id); }

/// The answer to the browser's lists of parts.
std::string SelectionText(const ordered_json& members) {
  ordered_json answer{{"type", "selection"}};
  answer.update(members);
  return answer.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

double Rounded(double ms) { return std::round(ms * 100) / 100; }

ordered_json Header(const DueFrame& due, const EncodedFrame& encoded, uint64_t number) {
  const View& view = due.wanted.view;
  ordered_json j{
      {"frame", number},
      {"input", due.wanted.input},
      {"time", due.wanted.time_ms},
      {"size", {view.width, view.height}},
      {"step", due.step},
      {"traced", static_cast<double>(due.traced) / (static_cast<double>(view.width) * view.height)},
      {"waiting", due.waiting},
      {"samples", due.samples},
      {"spp", view.spp},
      {"noise", due.noise},
      {"noise_wanted", view.noise},
      {"exact", !due.exact.empty()},
      {"exposure", due.exposure},
      {"queue_ms", Rounded(due.queue_s * 1e3)},
      {"trace_ms", Rounded(due.trace_s * 1e3)},
      {"encode_ms", Rounded(encoded.encode_s * 1e3)},
      {"stripes", ordered_json::array()}};
  for (const Stripe& stripe : encoded.stripes)
    j["stripes"].push_back({{"y", stripe.y},
                            {"height", stripe.height},
                            {"scale", stripe.scale},
                            {"format", stripe.png ? "png" : "jpeg"},
                            {"bytes", stripe.image.size()}});
  if (due.owners.empty()) return j;
  j["owners"] = ordered_json::array();
  for (const TracedBy& part : due.owners) {
    const PixelRect& p = part.pixels;
    j["owners"].push_back({p.x, p.y, p.width, p.height, part.worker});
  }
  return j;
}

std::shared_ptr<const Bytes> Pack(const ordered_json& header, const EncodedFrame& encoded) {
  const std::string text = header.dump();
  size_t bytes = sizeof(uint32_t) + text.size();
  for (const Stripe& stripe : encoded.stripes) bytes += stripe.image.size();
  auto message = std::make_shared<Bytes>();
  message->reserve(bytes);
  const auto append = [&](std::span<const std::byte> part) {
    message->insert(message->end(), part.begin(), part.end());
  };
  const auto length = static_cast<uint32_t>(text.size());
  append(std::as_bytes(std::span(&length, 1)));
  append(AsBytes(text));
  for (const Stripe& stripe : encoded.stripes) append(stripe.image);
  return message;
}

}  // namespace

Viewer::Viewer(ViewerSite& site, uint32_t id, std::shared_ptr<WebSocket> socket,
               std::function<void(const std::string&)> on_gone)
    : site_(site),
      socket_(std::move(socket)),
      on_gone_(std::move(on_gone)),
      pacer_(site.dispatcher, id, site.scene.catalog().materials),
      picker_(site.rays, site.scene, site.source, site.selections,
              [this](std::string json) {
                if (!gone_) SendAnswer(std::move(json));
              }),
      timer_(site.io),
      tokens_(kMostMessages),
      tokens_at_s_(site.now()),
      mistakes_(kMostMistakes),
      mistakes_at_s_(site.now()) {}

Viewer::~Viewer() { site_.memory.taken -= taken_; }

void Viewer::Start(const std::string& welcome) {
  socket_->Start(
      [self = weak_from_this()](const std::string& text) {
        if (const auto viewer = self.lock()) viewer->OnText(text);
      },
      [self = weak_from_this()](const Error& error) {
        if (const auto viewer = self.lock()) viewer->Gone(error.message);
      });
  socket_->SendText(welcome);
  welcome_bytes_ = welcome.size();
  started_ = true;
}

void Viewer::Gone(const std::string& why) {
  if (std::exchange(gone_, true)) return;
  timer_.Stop();
  saved_.reset();
  on_gone_(why);  // may destroy this once its caller is done
}

void Viewer::End(const std::string& sentence) {
  if (gone_) return;
  socket_->SendText(ErrorText(sentence));
  socket_->Close();
  Gone(sentence);
}

/// Bytes of texts that the browser has not taken.
uint64_t Viewer::text_bytes() const {
  uint64_t frames = 0;
  for (const auto& [number, sent] : under_way_)
    if (!sent.taken) frames += sent.bytes;
  const uint64_t queued = socket_->queued_bytes();
  return queued > frames ? queued - frames : 0;
}

void Viewer::Send(std::string json) {
  if (started_ && !gone_ && text_bytes() <= welcome_bytes_ + kBehindBytes) socket_->SendText(std::move(json));
}

void Viewer::SendState(std::string json) {
  if (!started_ || gone_) return;
  untold_.reset();
  if (text_bytes() <= welcome_bytes_ + kBehindBytes) return socket_->SendText(std::move(json));
  untold_ = std::move(json);
}

/// Sends an answer to a message of the browser.
void Viewer::SendAnswer(std::string json) {
  if (text_bytes() > welcome_bytes_ + kFarBehindBytes)
    return End("this page does not read the answers to its messages");
  socket_->SendText(std::move(json));
}

/// Refuses a message: the view is unchanged.
void Viewer::Refuse(const std::string& sentence) {
  const double now_s = site_.now();
  mistakes_ =
      std::min(kMostMistakes, mistakes_ + (now_s - std::exchange(mistakes_at_s_, now_s)) * kMistakesPerS);
  if (--mistakes_ < 0) return End("this page keeps sending messages that cannot be read; load it again");
  SendAnswer(RefusalText(sentence));
}

bool Viewer::TooMany() {
  const double now_s = site_.now();
  tokens_ = std::min(kMostMessages, tokens_ + (now_s - std::exchange(tokens_at_s_, now_s)) * kMessagesPerS);
  return --tokens_ < 0;
}

void Viewer::OnText(const std::string& text) {
  if (gone_) return;
  if (TooMany()) return End("this page sends too many messages");
  if (const Status status = OnMessage(text); !status) return End(status.error().message);
  Advance();
}

Status Viewer::OnMessage(const std::string& text) {
  uint64_t unknown = 0;
  auto message = ReadViewerMessage(text, site_.defaults, site_.facts.offset, site_.memory.most_pixels(),
                                   [&](uint64_t id) {
                                     auto lists = site_.selections.Find(id);
                                     if (!lists) unknown = id;
                                     return lists;
                                   });
  if (unknown != 0)
    return SendAnswer(SelectionText({{"error", message.error().message}, {"unknown", IdText(unknown)}})),
           Status{};
  if (!message) return Refuse(message.error().message), Status{};
  if (auto* view = std::get_if<WantedView>(&*message)) return OnView(std::move(*view));
  if (const auto* ack = std::get_if<AckMessage>(&*message)) OnAck(ack->frame);
  if (const auto* settings = std::get_if<SettingsMessage>(&*message)) OnSettings(*settings);
  if (const auto* pick = std::get_if<PickMessage>(&*message)) OnPick(*pick);
  if (const auto* select = std::get_if<SelectMessage>(&*message)) OnSelect(*select);
  if (auto* save = std::get_if<SaveMessage>(&*message)) OnSave(std::move(*save));
  return {};
}

void Viewer::OnPick(const PickMessage& pick) {
  if (!newest_) return Refuse("a pick was sent before any view");
  picker_.Ask(pick, *newest_);
  site_.assign_soon();
}

/// Resolves lists of parts, for the views that come.
void Viewer::OnSelect(const SelectMessage& select) {
  View view;
  view.parts.lists = select.lists;
  const Status known = site_.selections.Complete(view);
  const PartSelection* selection = view.parts.selection.get();
  const auto extent = known ? site_.selections.ExtentOf(selection) : tl::unexpected<Error>(known.error());
  if (!extent) return SendAnswer(SelectionText({{"error", extent.error().message}}));
  ordered_json members{{"id", selection ? IdText(selection->id) : ""}, {"hidden", extent->hidden}};
  const auto corner = [&](const glm::vec3& at) {
    const glm::dvec3 p = glm::dvec3(at) + site_.facts.offset;
    return ordered_json{p.x, p.y, p.z};
  };
  if (extent->lower.x <= extent->upper.x)
    members["shown_box"] = {corner(extent->lower), corner(extent->upper)};
  SendAnswer(SelectionText(members));
}

/// Requests a picture instead of the one requested before.
void Viewer::OnSave(SaveMessage message) {
  saved_.reset();
  if (!message.job) return;
  const auto answer_of = [save = message.save](const SavedPictures::News& news) {
    ordered_json j{{"type", "saved"}, {"save", save}, {"done", news.done}};
    if (!news.failure.empty()) j["error"] = news.failure;
    if (!news.file.empty()) j.update({{"file", news.file}, {"bytes", news.bytes}});
    return j.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
  };
  auto asked = site_.saved.Ask(std::move(*message.job),
                               [self = weak_from_this(), answer_of](const SavedPictures::News& news) {
                                 if (const auto viewer = self.lock(); viewer && !viewer->gone_)
                                   viewer->SendAnswer(answer_of(news));
                               });
  if (asked)
    saved_ = std::move(*asked);
  else
    SendAnswer(answer_of({.failure = asked.error().message}));
}

/// Takes memory for a view of this size.
Status Viewer::OnView(WantedView wanted) {
  const uint64_t pixels = uint64_t{wanted.view.width} * wanted.view.height;
  ViewMemory& memory = site_.memory;
  if (!memory.Fits(pixels, ViewMemory::BytesOf(pixels, wanted.view.noise > 0), taken_))
    return Fail(fmt::format(
        "there is no memory for another view of this size: all views together may take {} (--view-memory)",
        FormatSize(memory.most)));
  if (const Status known = site_.selections.Complete(wanted.view); !known)
    return Refuse(known.error().message), Status{};
  if (const Status known = site_.environments->Complete(wanted.view); !known)
    return Refuse(known.error().message), Status{};
  FitLight(wanted.view, site_.scene.catalog(), site_.environments->TableOf(wanted.view));
  memory.largest = std::max(memory.largest, pixels);
  Charge(BytesWith(wanted.view));
  newest_ = wanted.view;
  pacer_.Want(std::move(wanted), site_.now());
  return {};
}

/// Bytes of the newest view, and of the one before it while that is held.
uint64_t Viewer::BytesWith(const View& newest) const {
  const bool noise = newest.noise > 0 || (pacer_.current() && pacer_.current()->view.noise > 0);
  return ViewMemory::BytesOf(std::max(uint64_t{newest.width} * newest.height, pacer_.held_pixels()), noise);
}

/// Takes or returns memory, so that this viewer has `bytes`.
void Viewer::Charge(uint64_t bytes) {
  site_.memory.taken += bytes - taken_;
  taken_ = bytes;
}

void Viewer::OnSettings(const SettingsMessage& message) {
  settings_.frame_rate = message.frame_rate.value_or(settings_.frame_rate);
  settings_.step = message.step.value_or(settings_.step);
  settings_.wait = message.wait.value_or(settings_.wait);
  settings_.owners = message.owners.value_or(settings_.owners);
  quality_ = message.quality.value_or(quality_);
  pacer_.Set(settings_);
}

void Viewer::OnAck(uint64_t frame) {
  const auto it = under_way_.find(frame);
  if (it == under_way_.end()) return;
  it->second.acknowledged = true;
  if (!it->second.taken) return;
  under_way_.erase(it);
  pacer_.Acknowledged();
}

/// The system has taken a frame's message.
void Viewer::OnTaken(uint64_t frame) {
  const auto it = under_way_.find(frame);
  if (gone_ || it == under_way_.end()) return;
  it->second.taken = true;
  if (untold_) SendState(*std::exchange(untold_, std::nullopt));
  if (!it->second.acknowledged) return;
  under_way_.erase(it);
  pacer_.Acknowledged();
  Advance();
}

void Viewer::Take(const LiveTile& tile, std::span<const std::byte> pixels) {
  if (gone_) return;
  if (pacer_.Take(tile, pixels, site_.now())) Advance();
}

void Viewer::Advance() {
  if (gone_) return;
  while (auto due = pacer_.Step(site_.now())) due_.push_back(std::move(*due));
  if (newest_) Charge(BytesWith(*newest_));
  EncodeNext();
  site_.assign_soon();
  constexpr double kLongest = 3600;
  const double wait_s = pacer_.due_s() - site_.now();
  if (wait_s < kLongest)
    timer_.Set(std::max(wait_s, 0.0), [self = weak_from_this()] {
      if (const auto viewer = self.lock()) viewer->Advance();
    });
  else
    timer_.Stop();
}

/// One frame at a time, in their order. A moving frame overtakes an exact one, which is then not sent.
void Viewer::EncodeNext() {
  if (due_.empty() || encoding_ == Encoding::kMoving) return;
  const bool exact = !due_.front().exact.empty();
  if (encoding_ == Encoding::kExact) {
    if (exact) return;
    ++exact_overtaken_;
  }
  encoding_ = exact ? Encoding::kExact : Encoding::kMoving;
  auto due = std::make_shared<DueFrame>(std::move(due_.front()));
  due_.pop_front();
  EncodingThread& thread = exact ? site_.exact : site_.moving;
  // The tone table belongs to moving frames: an exact one may be encoded at the same time.
  thread.Encode({due, site_.facts, quality_, exact ? std::make_shared<std::optional<ToneTable>>() : tone_},
                [self = weak_from_this(), due](const Result<EncodedFrame>& encoded) {
                  if (const auto viewer = self.lock()) viewer->OnEncoded(*due, encoded);
                });
}

void Viewer::OnEncoded(DueFrame& due, const Result<EncodedFrame>& encoded) {
  const bool overtaken = !due.exact.empty() && exact_overtaken_ > 0;
  if (overtaken)
    --exact_overtaken_;
  else
    encoding_ = Encoding::kNone;
  if (gone_) return;
  if (!encoded) return End(encoded.error().message);
  if (overtaken) return pacer_.Acknowledged(), Advance();
  const uint64_t number = next_frame_++;
  ++frames_sent_;
  if (due.exact.empty() && due.samples == 0) site_.took_frame(due.trace_s);
  auto message = Pack(Header(due, *encoded, number), *encoded);
  under_way_.emplace(number, Sent{message->size(), site_.now()});
  socket_->SendBinary(std::move(message), [self = weak_from_this(), number] {
    if (const auto viewer = self.lock()) viewer->OnTaken(number);
  });
  pacer_.Reuse(std::move(due.rows));
  EncodeNext();
}

void Viewer::Sample(double now_s) {
  const double seconds = now_s - std::exchange(sampled_s_, now_s);
  frames_per_s_ = static_cast<double>(frames_sent_ - std::exchange(sampled_frames_, frames_sent_)) /
                  std::max(seconds, 0.1);
  if (untold_) SendState(*std::exchange(untold_, std::nullopt));
  double bytes = 0;
  for (const auto& [number, sent] : under_way_) {
    bytes += static_cast<double>(sent.bytes);
    if (!sent.taken && now_s - sent.at_s > kStallS + bytes / kSlowLine)
      return End("this page does not read the frames sent to it");
  }
}

}  // namespace quarry
