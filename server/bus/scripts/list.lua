-- KEYS: all records. ARGV: from and to (as ZRANGEBYLEX), what records' keys begin with. Returns where to go on, or nothing; then key, epoch
-- and value of each.
local limit = 500
local out, bytes = {''}, 0
local keys = redis.call('ZRANGEBYLEX', KEYS[1], ARGV[1], ARGV[2], 'LIMIT', 0, limit)
for i, key in ipairs(keys) do
  local there = redis.call('HMGET', ARGV[3] .. key, 'epoch', 'value')
  if there[1] then
    out[#out + 1], out[#out + 2], out[#out + 3] = key, there[1], there[2]
    bytes = bytes + #key + #there[2]
  end
  if i == limit or (bytes > 1048576 and i < #keys) then
    out[1] = '(' .. key
    return out
  end
end
return out
