#pragma once

#include <functional>
#include <string>
#include <utility>

#include "common/net/connection.h"

namespace quarry::test {

/// A connection on which nothing happens. Tests override the functions that they observe.
struct StillConnection : Connection {
  explicit StillConnection(std::string its_name = "there:1") : name(std::move(its_name)) {}
  void Start(OnMessage, OnClose) override {}
  void Expect(Speaker, uint32_t) override {}
  void Send(Message) override {}
  void Close() override {}
  uint64_t queued_bytes() const override { return 0; }
  uint64_t received_bytes() const override { return 0; }
  uint64_t taken_bytes() const override { return 0; }
  double unread_s() const override { return 0; }
  void SetOnSent(std::function<void()>) override {}
  std::string local_host() const override { return "here"; }
  const std::string& peer() const override { return name; }

  std::string name;
};

}  // namespace quarry::test
