-- KEYS: the log, the grace. ARGV: the log's channel, the number after which, new or kept, the entries.
-- Returns done, behind, grace or full; the log's last number; why it is full.
local top = redis.call('XREVRANGE', KEYS[1], '+', '-', 'COUNT', 1)[1]
local last = top and tonumber(string.match(top[1], '^%d+')) or 0
if ARGV[3] == 'new' and redis.call('EXISTS', KEYS[2]) == 1 then return {'grace', last, ''} end
if tonumber(ARGV[2]) ~= last then return {'behind', last, ''} end
for i = 4, #ARGV do
  local added = redis.pcall('XADD', KEYS[1], string.format('%.0f-0', last + i - 3), 'e', ARGV[i])
  if type(added) == 'table' and added.err then
    -- Redis refuses the first write of a script or none.
    if i == 4 and (string.find(added.err, '^OOM') or string.find(added.err, '^MISCONF')) then return {'full', last, added.err} end
    return redis.error_reply(added.err)
  end
end
last = last + #ARGV - 3
redis.pcall('PUBLISH', ARGV[1], string.format('%.0f', last))
return {'done', last, ''}
