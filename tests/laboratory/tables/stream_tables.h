#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "common/base/status.h"
#include "tests/laboratory/machine/study.h"

namespace quarry::laboratory {

/// Prints the tables and figures of Purcell et al. 2002 that a study gives, as Markdown. `bunny`: the scene
/// is the paper's, and its figures stand beside.
void PrintStudy(const Study& study, const StudyOptions& options, bool bunny);
/// All numbers of the study.
nlohmann::ordered_json StudyToJson(const Study& study);
/// Draws figures 7, 8 and 9 into `folder`: NAME-figure-7.png and so on. Errors: gnuplot is missing or fails.
Status DrawStudy(const Study& study, const std::string& folder, const std::string& name);

}  // namespace quarry::laboratory
