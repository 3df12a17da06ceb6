#include "server/bus/protocol.h"

#include <hiredis/hiredis.h>

#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast::bus {

namespace {

// hiredis makes a reply's parts by these, top down. Null: it gives up.
Reply* place(const redisReadTask* task) {
  return task->parent ? &static_cast<Reply*>(task->parent->obj)->parts[static_cast<std::size_t>(task->idx)] : new Reply;
}
void* makeText(const redisReadTask* task, char* text, std::size_t size) {
  Reply* const reply = place(task);
  reply->kind = task->type == REDIS_REPLY_ERROR ? Reply::Kind::kError : Reply::Kind::kText;
  reply->text.assign(text, size);
  return reply;
}
void* makeArray(const redisReadTask* task, int elements) {
  std::size_t& parts = *static_cast<std::size_t*>(task->privdata);
  const auto more = static_cast<std::size_t>(elements);
  if (more > ReplyReader::kMaxParts - parts) return nullptr;
  parts += more;
  Reply* const reply = place(task);
  reply->kind = Reply::Kind::kArray;
  reply->parts.resize(more);
  return reply;
}
void* makeInteger(const redisReadTask* task, long long value) {
  Reply* const reply = place(task);
  reply->kind = Reply::Kind::kInteger;
  reply->integer = value;
  return reply;
}
void* makeNil(const redisReadTask* task) { return place(task); }
void freeReply(void* reply) { delete static_cast<Reply*>(reply); }

redisReplyObjectFunctions functions{makeText, makeArray, makeInteger, makeNil, freeReply};

}  // namespace

std::string command(const std::vector<std::string_view>& arguments) {
  std::size_t bytes = 16;
  for (const std::string_view argument : arguments) bytes += argument.size() + 32;
  std::string out;
  out.reserve(bytes);
  out += "*" + std::to_string(arguments.size()) + "\r\n";
  for (const std::string_view argument : arguments) {
    out += "$" + std::to_string(argument.size()) + "\r\n";
    out += argument;
    out += "\r\n";
  }
  return out;
}

void ReplyReader::End::operator()(redisReader* reader) const { redisReaderFree(reader); }

ReplyReader::ReplyReader() : reader_(redisReaderCreateWithFunctions(&functions)) {
  expects(reader_ != nullptr, "there is memory for a reader");
  reader_->privdata = &parts_;
}

void ReplyReader::feed(std::string_view bytes) { redisReaderFeed(reader_.get(), bytes.data(), bytes.size()); }

Outcome<std::optional<Reply>> ReplyReader::next() {
  void* made = nullptr;
  if (redisReaderGetReply(reader_.get(), &made) != REDIS_OK || reader_->len - reader_->pos > kMaxBytes)
    return Error{"it does not answer as Redis does"};
  if (!made) return std::optional<Reply>();
  const std::unique_ptr<Reply> reply(static_cast<Reply*>(made));
  parts_ = 0;
  return std::optional(std::move(*reply));
}

}  // namespace ridgecast::bus
