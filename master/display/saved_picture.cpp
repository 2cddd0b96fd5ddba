#include "master/display/saved_picture.h"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <utility>

#include "master/display/page.h"

namespace quarry {

/// The job's client: a connection for the jobs, whose messages arrive here.
class SavedPicture final : public Connection {
 public:
  SavedPicture(SavedPictures& site, SavedPictures::OnNews on_news)
      : site_(site), on_news_(std::move(on_news)) {}

  void Start(OnMessage, OnClose) override {}
  void Expect(Speaker, uint32_t) override {}
  /// Jobs send while they iterate over their clients, so a message is handled in a later event.
  void Send(Message message) override {
    queued_ += message.raw.size();
    boost::asio::post(site_.io_, [self = weak_from_this(), message = std::move(message)]() mutable {
      if (const auto picture = self.lock()) static_cast<SavedPicture&>(*picture).Take(std::move(message));
    });
  }
  void Close() override {}
  uint64_t queued_bytes() const override { return queued_; }
  uint64_t taken_bytes() const override { return 0; }
  double unread_s() const override { return 0; }
  void SetOnSent(std::function<void()>) override {}
  uint64_t received_bytes() const override { return 0; }
  const std::string& peer() const override { return peer_; }
  std::string local_host() const override { return {}; }

 private:
  void Take(Message message) {
    queued_ -= message.raw.size();
    if (!on_news_) return;
    SavedPictures::News news;
    if (message.type == MessageType::kFrameProgress) {
      const auto progress = DecodeFrameProgress(message.table);
      if (!progress || progress->tiles == 0) return;
      news.done = static_cast<double>(progress->tiles_done) / progress->tiles;
      return on_news_(news);
    }
    if (message.type == MessageType::kFrameDone) {
      news.done = 1;
      news.bytes = message.raw.size();
      news.file = site_.Keep(std::move(message.raw));
    } else {
      const auto failure = DecodeFailure(message.table);
      news.failure = failure ? failure->message : "the master is shutting down";
    }
    std::exchange(on_news_, nullptr)(news);
  }

  SavedPictures& site_;
  SavedPictures::OnNews on_news_;  ///< empty after the last news
  uint64_t queued_ = 0;
  const std::string peer_ = "a viewer";
};

SavedPictures::SavedPictures(boost::asio::io_context& io, JobService jobs, std::function<double()> now)
    : io_(io), jobs_(std::move(jobs)), now_(std::move(now)) {}

SavedPictures::~SavedPictures() = default;

Result<std::shared_ptr<SavedPicture>> SavedPictures::Ask(RenderJob job, OnNews on_news) {
  const auto picture = std::make_shared<SavedPicture>(*this, std::move(on_news));
  QUARRY_TRY(jobs_.ask(picture, JobRequest{std::move(job), 0}));
  // The jobs hold their clients. The viewer holds this object; its destructor informs the jobs.
  return std::shared_ptr<SavedPicture>(picture.get(),
                                       [this, picture](SavedPicture*) { jobs_.forget(picture); });
}

/// Keeps a file under a name that nobody can guess.
std::string SavedPictures::Keep(Bytes image) {
  std::array<uint8_t, 16> random{};
  if (::getentropy(random.data(), random.size()) != 0) return {};
  std::string name = "saved-";
  for (const uint8_t byte : random) name += fmt::format("{:02x}", byte);
  name += ".png";
  // The memory is counted as long as anybody holds the bytes, such as an answer that is being sent.
  auto held = jobs_.hold(image.size());
  const std::shared_ptr<const Bytes> bytes(new Bytes(std::move(image)),
                                           [held = std::move(held)](const Bytes* gone) { delete gone; });
  files_.emplace(name, File{bytes, now_()});
  return name;
}

HttpResponse SavedPictures::Fetch(const std::string& name) const {
  const auto it = files_.find(name);
  if (it == files_.end())
    return Refused(404, fmt::format("this picture has been removed: pictures are kept for {} s", kKeepS));
  return {.content_type = "image/png",
          .headers = {{"Content-Disposition", "attachment"}},
          .file = it->second.bytes};
}

bool SavedPictures::Names(const std::string& name) {
  return name.starts_with("saved-") && name.ends_with(".png");
}

void SavedPictures::Tick() {
  std::erase_if(files_, [&](const auto& file) { return now_() - file.second.since_s > kKeepS; });
}

}  // namespace quarry
