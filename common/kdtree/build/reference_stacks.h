#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <utility>

#include "common/kdtree/build/build.h"

namespace quarry {

/// The references of the nodes that a build has still to split, on two stacks. A node's references lie on top
/// of one; when it is split, its right child's stay there and its left child's go to the other. The left
/// child is built first. No reference is copied more often than it is divided. Thread safety: none.
class ReferenceStacks {
 public:
  using Range = ReferenceRange;

  /// Holds the references of a root alone.
  Range Start(std::span<const KdReference> references) {
    stacks_[0].size = stacks_[1].size = 0;
    std::ranges::copy(references, Room(0, references.size()));
    stacks_[0].size = references.size();
    return {};
  }
  std::span<KdReference> Of(Range range) {
    Stack& stack = stacks_[range.stack];
    return {stack.references.get() + range.begin, stack.size - range.begin};
  }
  /// Removes a node's references.
  void Drop(Range range) { stacks_[range.stack].size = range.begin; }

  /// The upper end of the stack that `range` does not lie on.
  Range Beside(Range range) const { return {1 - range.stack, stacks_[1 - range.stack].size}; }
  /// Room for `count` references on top of a stack; the other stack stays where it is.
  KdReference* Room(int number, size_t count) {
    Stack& stack = stacks_[number];
    if (stack.room < stack.size + count) {
      stack.room = std::max(stack.size + count, stack.room + stack.room / 2);
      auto larger = std::make_unique_for_overwrite<KdReference[]>(stack.room);
      std::copy_n(stack.references.get(), stack.size, larger.get());
      stack.references = std::move(larger);
    }
    return stack.references.get() + stack.size;
  }
  /// Sets the number of references of the upper end of a stack. Requires: there is room for them.
  void SetCount(Range range, ptrdiff_t count) {
    stacks_[range.stack].size = range.begin + static_cast<size_t>(count);
  }

 private:
  struct Stack {
    std::unique_ptr<KdReference[]> references;
    size_t size = 0, room = 0;
  };
  Stack stacks_[2];
};

}  // namespace quarry
