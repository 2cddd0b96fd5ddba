#include "preprocess/texture/image_reader.h"

#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

namespace quarry {
namespace {

constexpr size_t kMostPieces = 6;

}  // namespace

struct ImageReader::Impl {
  Impl(const std::vector<TextureImage>& list, size_t first, const ImageDecoding& decoding)
      : images(list), decoder(decoding), thread([this, first] { Run(first); }) {}

  void Run(size_t first) {
    for (size_t i = first; i < images.size(); ++i) {
      Piece end;
      end.status = decoder.DecodeRows(
          images[i],
          [&](const ImageFacts& facts) {
            Piece piece;
            piece.kind = Piece::Kind::kFacts;
            piece.facts = facts;
            return Put(std::move(piece));
          },
          [&](Bytes rows) {
            Piece piece;
            piece.kind = Piece::Kind::kRows;
            piece.rows = std::move(rows);
            return Put(std::move(piece));
          });
      end.remark = decoder.remark();
      end.fatal = !end.status && decoder.is_fatal();
      const bool last = end.fatal;
      if (!Put(std::move(end)) || last) return;
    }
  }

  /// Waits for room. Errors: the reader is being destroyed.
  Status Put(Piece piece) {
    {
      std::unique_lock lock(mutex);
      changed.wait(lock, [&] { return pieces.size() < kMostPieces || closed; });
      if (closed) return Fail("no longer wanted");
      pieces.push_back(std::move(piece));
    }
    changed.notify_all();
    return {};
  }

  const std::vector<TextureImage>& images;
  ImageDecoder decoder;
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<Piece> pieces;
  bool closed = false;
  std::thread thread;  ///< last: it uses the others
};

ImageReader::ImageReader(const std::vector<TextureImage>& images, size_t first, ImageDecoding decoding)
    : impl_(std::make_unique<Impl>(images, first, std::move(decoding))) {}

ImageReader::~ImageReader() {
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->closed = true;
  }
  impl_->changed.notify_all();
  impl_->thread.join();
}

ImageReader::Piece ImageReader::Next() {
  Piece piece;
  {
    std::unique_lock lock(impl_->mutex);
    impl_->changed.wait(lock, [&] { return !impl_->pieces.empty(); });
    piece = std::move(impl_->pieces.front());
    impl_->pieces.pop_front();
  }
  impl_->changed.notify_all();
  return piece;
}

}  // namespace quarry
