#include "rig/complaints.h"

#include <algorithm>
#include <utility>

#include "sfm/core/name_list.h"

namespace rotunda::rig {
namespace {

/// A text cut at its figures: a word, a figure, ..., a word.
struct CutText {
  std::vector<std::string> words;
  std::vector<std::string> figures;
};

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

size_t EndOfDigits(const std::string& text, size_t begin) {
  while (begin < text.size() && IsDigit(text[begin])) ++begin;
  return begin;
}

/// Behind the figure that begins at `begin`: digits, with or without a fraction.
size_t EndOfFigure(const std::string& text, size_t begin) {
  const size_t end = EndOfDigits(text, begin);
  const bool has_fraction = end + 1 < text.size() && text[end] == '.' && IsDigit(text[end + 1]);
  return has_fraction ? EndOfDigits(text, end + 1) : end;
}

CutText CutAtFigures(const std::string& text) {
  CutText cut;
  cut.words.emplace_back();
  for (size_t at = 0; at < text.size();) {
    if (!IsDigit(text[at])) {
      cut.words.back() += text[at++];
      continue;
    }
    const size_t end = EndOfFigure(text, at);
    cut.figures.push_back(text.substr(at, end - at));
    cut.words.emplace_back();
    at = end;
  }
  return cut;
}

/// From the least to the most of a figure, as they were written.
struct FigureRange {
  std::string least;
  std::string most;

  void Include(const std::string& figure) {
    if (std::stod(figure) < std::stod(least)) least = figure;
    if (std::stod(figure) > std::stod(most)) most = figure;
  }
  std::string Text() const { return least == most ? least : least + " to " + most; }
};

/// Cameras with the same complaint.
class ComplaintGroup {
 public:
  explicit ComplaintGroup(const Complaint& first) : what_(first.what), cameras_{first.camera} {
    CutText cut = Cut(first);
    words_ = std::move(cut.words);
    for (const std::string& figure : cut.figures) ranges_.push_back({figure, figure});
  }

  /// False: it is another complaint.
  bool Take(const Complaint& one) {
    const CutText cut = Cut(one);
    if (one.what != what_ || cut.words != words_) return false;
    for (size_t i = 0; i < ranges_.size(); ++i) ranges_[i].Include(cut.figures[i]);
    cameras_.push_back(one.camera);
    return true;
  }

  std::string Text(size_t all) const {
    const std::string reason = Reason();
    const std::string why = what_ + (reason.empty() ? "" : " (" + reason + ")");
    if (cameras_.size() == 1) return cameras_.front() + " " + why;
    if (cameras_.size() == all) return "all " + why;
    return std::to_string(cameras_.size()) + " " + why + ": " + ListOfNames(cameras_);
  }

 private:
  static CutText Cut(const Complaint& one) {
    return one.measured ? CutAtFigures(one.reason) : CutText{{one.reason}, {}};
  }
  std::string Reason() const {
    std::string text = words_.front();
    for (size_t i = 0; i < ranges_.size(); ++i) text += ranges_[i].Text() + words_[i + 1];
    return text;
  }

  std::string what_;
  std::vector<std::string> words_;
  std::vector<FigureRange> ranges_;
  std::vector<std::string> cameras_;
};

}  // namespace

std::vector<std::string> GroupComplaints(const std::vector<Complaint>& complaints, size_t cameras) {
  std::vector<ComplaintGroup> groups;
  for (const Complaint& one : complaints) {
    const bool is_known = std::any_of(groups.begin(), groups.end(),
                                      [&](ComplaintGroup& group) { return group.Take(one); });
    if (!is_known) groups.emplace_back(one);
  }
  std::vector<std::string> texts;
  for (const ComplaintGroup& group : groups) texts.push_back(group.Text(cameras));
  return texts;
}

}  // namespace rotunda::rig
