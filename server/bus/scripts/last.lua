-- KEYS: the log. ARGV: the channel to answer on, the log's channel. In the order of the log's own messages, as a reply would not be.
local top = redis.call('XREVRANGE', KEYS[1], '+', '-', 'COUNT', 1)[1]
return redis.call('PUBLISH', ARGV[1], (top and string.match(top[1], '^%d+') or '0') .. ' ' .. ARGV[2])
