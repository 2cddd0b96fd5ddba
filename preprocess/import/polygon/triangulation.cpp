#include "preprocess/import/polygon/triangulation.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "preprocess/import/polygon/orientation.h"

namespace quarry {
namespace {

constexpr uint32_t kNone = 0xFFFFFFFFu;
// Limits of work, in nodes and corners inspected per corner of the polygon: 30 to 1,200 are usual, spikes
// across the whole polygon take 4,000 (7 s at 60,000 corners). A polygon that crosses itself has no right
// answer and gets less (1 s).
constexpr uint64_t kMostWork = 6000, kMostWorkOnCrossing = 400;

/// The half-plane of a direction: 0 for angles in [0, 180) degrees, else 1.
int HalfOf(const glm::vec2& from, const glm::vec2& to) {
  if (to.y != from.y) return to.y < from.y;
  return to.x < from.x;
}

}  // namespace

int ExactOrientation(const glm::vec2& a, const glm::vec2& b, const glm::vec2& c) {
  const double products[] = {double{a.x} * b.y,    -(double{a.x} * c.y), -(double{c.x} * b.y),
                             -(double{a.y} * b.x), double{a.y} * c.x,    double{c.y} * b.x};
  double sum[6] = {};
  int terms = 0;
  for (const double product : products) {
    double carry = product;
    for (int i = 0; i < terms; ++i) {
      const double whole = carry + sum[i], part = whole - carry;
      sum[i] = (carry - (whole - part)) + (sum[i] - part);
      carry = whole;
    }
    sum[terms++] = carry;
  }
  for (int i = terms; i-- > 0;)
    if (sum[i] != 0) return sum[i] > 0 ? 1 : -1;
  return 0;
}

std::span<const Triangulator::Triangle> Triangulator::Split(std::span<const glm::vec3> corners) {
  triangles_.clear();
  if (corners.size() > 3 && Project(corners) && !FanCovers()) Clip();
  return triangles_;
}

/// False: a corner is not finite, or the area is 0, so that no direction is best.
bool Triangulator::Project(std::span<const glm::vec3> corners) {
  glm::dvec3 normal(0);
  const glm::dvec3 origin(corners[0]);
  glm::dvec3 before = glm::dvec3(corners.back()) - origin;
  for (const glm::vec3& corner : corners) {
    const glm::dvec3 now = glm::dvec3(corner) - origin;
    normal.x += (before.y - now.y) * (before.z + now.z);
    normal.y += (before.z - now.z) * (before.x + now.x);
    normal.z += (before.x - now.x) * (before.y + now.y);
    before = now;
  }
  int axis = std::fabs(normal.x) > std::fabs(normal.y) ? 0 : 1;
  if (!(std::fabs(normal[axis]) > std::fabs(normal.z))) axis = 2;
  if (!std::isfinite(normal.x + normal.y + normal.z) || normal[axis] == 0) return false;
  int u = (axis + 1) % 3, v = (axis + 2) % 3;
  if (normal[axis] < 0) std::swap(u, v);
  at_.resize(corners.size());
  for (size_t i = 0; i < corners.size(); ++i) at_[i] = {corners[i][u], corners[i][v]};
  return true;
}

/// Whether the other corners, seen from the first, go round to the left by less than a full turn.
bool Triangulator::FanCovers() const {
  const glm::vec2& centre = at_[0];
  size_t first = 1;
  while (first < at_.size() && at_[first] == centre) ++first;
  if (first == at_.size()) return true;
  int half = HalfOf(centre, at_[first]), changes = 0;
  for (size_t before = first, i = first + 1; i < at_.size(); ++i) {
    if (at_[i] == centre) continue;
    const int turn = Orientation(centre, at_[before], at_[i]);
    if (turn < 0) return false;
    const int now = HalfOf(centre, at_[i]);
    if (now != half && turn == 0) return false;  // an edge passes through the first corner
    changes += now != half;
    if (changes == 2 && Orientation(centre, at_[first], at_[i]) >= 0) return false;
    half = now;
    before = i;
  }
  return changes <= 2;
}

int Triangulator::TurnAt(uint32_t corner) const {
  const Place& place = ring_[corner];
  return Orientation(at_[place.before], at_[corner], at_[place.after]);
}

void Triangulator::Clip() {
  const auto count = static_cast<uint32_t>(at_.size());
  ring_.resize(count);
  queue_.resize(count);
  queue_begin_ = queue_length_ = 0;
  tree_.Build(at_);
  left_ = count;
  some_ = 0;
  work_ = 0;
  for (uint32_t i = 0; i < count; ++i)
    ring_[i] = {
        i == 0 ? count - 1 : i - 1, i + 1 == count ? 0 : i + 1, kNone, kNone, kNone, kNone, false, false};
  for (uint32_t i = 0; i < count; ++i) Update(i);
  most_work_ = kMostWork * count + (1 << 16);
  for (CutEars(); left_ > 3 && work_ < most_work_; CutEars()) {
    const uint32_t before = left_;
    CutFlat();
    if (left_ == before && !CutByForce()) break;
  }
  CutRestAsFan();
}

/// Cuts off ears until none is known. Corners that wait for a corner at their own place are not woken by all
/// changes there, so all corners are tested once more before the end.
void Triangulator::CutEars() {
  for (uint32_t before = 0; before != left_ && left_ > 3;) {
    while (queue_length_ > 0 && left_ > 3 && work_ < most_work_) {
      const uint32_t corner = queue_[queue_begin_];
      queue_begin_ = (queue_begin_ + 1) % queue_.size();
      --queue_length_;
      ring_[corner].queued = false;
      if (!ring_[corner].gone && !tree_.marked(corner) && IsEar(corner, false)) Cut(corner);
    }
    if (before == left_) return;
    before = left_;
    uint32_t corner = some_;
    for (uint32_t i = 0; i < left_; ++i, corner = ring_[corner].after) Enqueue(corner);
    work_ += left_;
  }
}

/// Cuts corners without area: on a straight edge, at the end of a spike, repeated at a place.
void Triangulator::CutFlat() {
  uint32_t corner = some_;
  for (uint32_t looks = left_; looks > 0 && left_ > 3; --looks) {
    const uint32_t after = ring_[corner].after;
    if (TurnAt(corner) == 0) Cut(corner);
    corner = after;
    ++work_;
  }
}

/// Where the polygon crosses or touches itself: cuts a corner whose triangle's inside holds no other corner,
/// or any.
bool Triangulator::CutByForce() {
  uint32_t corner = some_, turning = kNone;
  for (uint32_t i = 0; i < left_; ++i, corner = ring_[corner].after) {
    ++work_;
    if (TurnAt(corner) <= 0) continue;
    turning = corner;
    if (IsEar(corner, true)) break;
  }
  if (turning == kNone) return false;
  Cut(turning);
  most_work_ = std::min(most_work_, kMostWorkOnCrossing * at_.size());
  return true;
}

void Triangulator::CutRestAsFan() {
  const uint32_t centre = some_;
  for (; left_ >= 3; --left_) {
    const uint32_t b = ring_[centre].after, c = ring_[b].after;
    triangles_.push_back({centre, b, c});
    ring_[centre].after = c;
  }
}

/// Requires: the corner turns left.
bool Triangulator::IsEar(uint32_t corner, bool strictly_inside_only) {
  const Place& place = ring_[corner];
  const glm::vec2 triangle[] = {at_[place.before], at_[corner], at_[place.after]};
  uint32_t blocker = kNone;
  const bool blocked = tree_.FindNear(triangle, work_, [&](uint32_t other) {
    blocker = other;
    return Blocks(other, corner, strictly_inside_only);
  });
  if (blocked && !strictly_inside_only) Watch(corner, blocker);
  return !blocked;
}

/// Whether a corner blocks `ear`: it lies in the ear's triangle or on its border. A corner at the place of
/// one of the ear's own corners (as at the ends of a keyhole) blocks if an edge leads from it into the
/// triangle.
bool Triangulator::Blocks(uint32_t corner, uint32_t ear, bool strictly_inside_only) const {
  const Place& place = ring_[ear];
  if (corner == place.before || corner == ear || corner == place.after) return false;
  const glm::vec2 &p = at_[corner], &a = at_[place.before], &b = at_[ear], &c = at_[place.after];
  const int ab = Orientation(a, b, p), bc = Orientation(b, c, p), ca = Orientation(c, a, p);
  if (ab < 0 || bc < 0 || ca < 0) return false;
  if (strictly_inside_only) return ab > 0 && bc > 0 && ca > 0;
  if (p == a) return Enters(corner, c, a, b);
  if (p == b) return Enters(corner, a, b, c);
  if (p == c) return Enters(corner, b, c, a);
  return true;
}

/// Whether an edge of `corner`, which lies at `at`, leads between the directions to `to` and `from`.
bool Triangulator::Enters(uint32_t corner, const glm::vec2& from, const glm::vec2& at,
                          const glm::vec2& to) const {
  for (const uint32_t other : {ring_[corner].before, ring_[corner].after})
    if (Orientation(from, at, at_[other]) > 0 && Orientation(at, to, at_[other]) > 0) return true;
  return false;
}

void Triangulator::Cut(uint32_t corner) {
  Place& place = ring_[corner];
  triangles_.push_back({place.before, corner, place.after});
  ring_[place.before].after = place.after;
  ring_[place.after].before = place.before;
  place.gone = true;
  some_ = place.after;
  --left_;
  Unwatch(corner);
  tree_.Mark(corner, false);
  WakeWatchers(corner);
  Update(place.before);
  Update(place.after);
}

/// Tests the corner again after its neighbours have changed.
void Triangulator::Update(uint32_t corner) {
  const bool turns_left = TurnAt(corner) > 0;
  tree_.Mark(corner, !turns_left);
  if (!turns_left) return;
  WakeWatchers(corner);
  Enqueue(corner);
}

void Triangulator::Enqueue(uint32_t corner) {
  if (ring_[corner].queued || tree_.marked(corner)) return;
  Unwatch(corner);
  ring_[corner].queued = true;
  queue_[(queue_begin_ + queue_length_++) % queue_.size()] = corner;
}

void Triangulator::Watch(uint32_t ear, uint32_t blocker) {
  Unwatch(ear);
  Place& place = ring_[ear];
  place.blocker = blocker;
  place.watcher_before = kNone;
  place.watcher_after = ring_[blocker].watchers;
  if (place.watcher_after != kNone) ring_[place.watcher_after].watcher_before = ear;
  ring_[blocker].watchers = ear;
}

void Triangulator::Unwatch(uint32_t ear) {
  Place& place = ring_[ear];
  if (place.blocker == kNone) return;
  if (place.watcher_before != kNone)
    ring_[place.watcher_before].watcher_after = place.watcher_after;
  else
    ring_[place.blocker].watchers = place.watcher_after;
  if (place.watcher_after != kNone) ring_[place.watcher_after].watcher_before = place.watcher_before;
  place.blocker = kNone;
}

void Triangulator::WakeWatchers(uint32_t blocker) {
  while (ring_[blocker].watchers != kNone) {
    const uint32_t ear = ring_[blocker].watchers;
    Unwatch(ear);
    Enqueue(ear);
  }
}

}  // namespace quarry
