#include "deploy/command/command_output.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/process.hpp>
#include <future>
#include <sstream>

namespace quarry {

namespace bp = boost::process;

std::string CommandOutput::LastError() const {
  std::istringstream lines(err);
  std::string line, last;
  while (std::getline(lines, line))
    if (line.find_first_not_of(" \t\r") != std::string::npos) last = line;
  return last;
}

Result<CommandOutput> OutputOf(const std::string& name, const std::vector<std::string>& arguments) {
  const boost::filesystem::path path = bp::search_path(name);
  if (path.empty()) return Fail(fmt::format("there is no {} on this machine's PATH", name));
  try {
    boost::asio::io_context io;
    std::future<std::string> out, err;
    const int status =
        bp::system(path, bp::args(arguments), bp::std_in<bp::null, bp::std_out> out, bp::std_err > err, io);
    return CommandOutput{status, out.get(), err.get()};
  } catch (const std::exception& e) {
    return Fail(fmt::format("cannot run {}: {}", name, e.what()));
  }
}

}  // namespace quarry
