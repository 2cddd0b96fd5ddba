#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "common/engine/scene.h"
#include "common/http/http_server.h"
#include "common/net/timer.h"
#include "master/display/encoding_thread.h"
#include "master/display/picker.h"
#include "master/display/saved_picture.h"
#include "master/display/view_pacer.h"
#include "master/display/viewer_message.h"
#include "master/environments.h"
#include "master/part_selections.h"

namespace boost::asio {
class io_context;
}  // namespace boost::asio

namespace quarry {

/// The memory that all views may take together. Units: bytes.
struct ViewMemory {
  uint64_t most = 256u << 20, taken = 0;
  uint64_t largest = 0;  ///< pixels of a view so far; the encoder keeps memory for it
  /// Bytes for a pixel of a view: its picture with copied rows, the exact frame, and the messages of two
  /// pending frames, as PNGs that do not compress. Bytes of the encoder for a pixel of the largest view.
  static constexpr uint64_t kPixelBytes = LivePicture::kPixelBytes + kColorWords * 4 + 2 * 4,
                            kEncoderBytes = 24;
  /// Bytes for the pixels of a view; `noise`: it has one, or the view before it has.
  static uint64_t BytesOf(uint64_t pixels, bool noise) {
    return pixels * (kPixelBytes + (noise ? LivePicture::kNoiseBytes : 0));
  }
  uint64_t most_pixels() const { return most / (kPixelBytes + kEncoderBytes); }
  /// Whether a view of `pixels` that takes `bytes` has room; `own`: bytes that its viewer has now.
  bool Fits(uint64_t pixels, uint64_t bytes, uint64_t own) const {
    return taken - own + bytes + std::max(largest, pixels) * kEncoderBytes <= most;
  }
};

/// The objects that viewers share. They outlive the viewers.
struct ViewerSite {
  boost::asio::io_context& io;
  EncodingThread& moving;  ///< for frames in motion
  EncodingThread& exact;   ///< for exact frames, which take much longer than moving ones
  LiveDispatcher& dispatcher;
  RayDispatcher& rays;
  const Scene& scene;
  PartSelections& selections;  ///< of the scene
  VoxelSource& source;         ///< of the scene's blocks
  SavedPictures& saved;
  SceneFacts facts;
  ViewDescription defaults;  ///< of views
  ViewMemory memory;
  std::function<void()> assign_soon;       ///< there is something to trace
  std::function<double()> now;             ///< seconds of a steady clock
  std::function<void(double)> took_frame;  ///< seconds that a frame's tracing took
  const Environments* environments;        ///< that views may name
};

/// A watching browser: its WebSocket, its pacer, and its pending frames. Runs on the
/// io_context's thread; images are encoded on the site's threads.
class Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  /// `id`: its number at the dispatcher. `on_gone`: called once, when the browser or this side has ended it.
  Viewer(ViewerSite& site, uint32_t id, std::shared_ptr<WebSocket> socket,
         std::function<void(const std::string&)> on_gone);
  ~Viewer();

  void Start(const std::string& welcome);
  /// Takes a finished tile of one of its frames, and continues.
  void Take(const LiveTile& tile, std::span<const std::byte> pixels);
  /// Sends frames that are due, and orders tiles.
  void Advance();
  /// Sends a text, unless the browser is behind or has not been welcomed.
  void Send(std::string json);
  /// Sends the cluster's state as soon as the browser is not behind.
  void SendState(std::string json);
  /// Sends the reason and ends the connection.
  void End(const std::string& sentence);

  uint64_t frames_sent() const { return frames_sent_; }
  uint64_t abandoned() const { return pacer_.abandoned(); }
  double frames_per_s() const { return frames_per_s_; }
  /// Measures frames_per_s(), and disconnects a viewer that takes nothing. Called about once a second.
  void Sample(double now_s);

 private:
  void OnText(const std::string& text);
  Status OnMessage(const std::string& text);
  Status OnView(WantedView wanted);
  uint64_t BytesWith(const View& newest) const;
  void Charge(uint64_t bytes);
  void OnSettings(const SettingsMessage& message);
  void OnAck(uint64_t frame);
  void OnPick(const PickMessage& pick);
  void OnSelect(const SelectMessage& select);
  void OnSave(SaveMessage message);
  bool TooMany();
  void Refuse(const std::string& sentence);
  void SendAnswer(std::string json);
  uint64_t text_bytes() const;
  void OnTaken(uint64_t frame);
  void EncodeNext();
  void OnEncoded(DueFrame& due, const Result<EncodedFrame>& encoded);
  void Gone(const std::string& why);

  ViewerSite& site_;
  const std::shared_ptr<WebSocket> socket_;
  std::function<void(const std::string&)> on_gone_;
  ViewPacer pacer_;
  Picker picker_;
  ViewSettings settings_;
  int quality_ = 80;
  uint64_t taken_ = 0;  ///< bytes of site_.memory
  std::optional<View> newest_;
  std::shared_ptr<SavedPicture> saved_;  ///< the picture that is being saved, or was saved last
  Timer timer_;
  std::deque<DueFrame> due_;  ///< to be encoded
  enum class Encoding { kNone, kMoving, kExact };
  Encoding encoding_ = Encoding::kNone;  ///< the newest frame under way
  uint32_t exact_overtaken_ = 0;  ///< exact frames under way that moving ones have overtaken: the oldest
  std::shared_ptr<std::optional<ToneTable>> tone_ = std::make_shared<std::optional<ToneTable>>();
  uint64_t next_frame_ = 1, frames_sent_ = 0;
  /// A frame that was sent. It is pending until the browser has acknowledged it and the system has taken its
  /// message: a browser may acknowledge frames that it does not read.
  struct Sent {
    uint64_t bytes = 0;
    double at_s = 0;
    bool acknowledged = false, taken = false;
  };
  std::map<uint64_t, Sent> under_way_;  ///< by number
  std::optional<std::string> untold_;   ///< the newest state, while the browser is behind
  uint64_t welcome_bytes_ = 0;
  double tokens_ = 0, tokens_at_s_ = 0;
  double mistakes_ = 0, mistakes_at_s_ = 0;
  uint64_t sampled_frames_ = 0;
  double sampled_s_ = 0, frames_per_s_ = 0;
  bool started_ = false, gone_ = false;
};

}  // namespace quarry
