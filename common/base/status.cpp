#include "common/base/status.h"

#include <system_error>

namespace quarry {

std::string ErrnoText(int error_number) { return std::generic_category().message(error_number); }

}  // namespace quarry
